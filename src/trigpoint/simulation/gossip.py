"""Random gossip: at each tick one random arc is met exactly by its two ends (theory 6-F5)."""

from __future__ import annotations

import numpy as np

from trigpoint.arrays import FloatArray
from trigpoint.errors import ArgumentError
from trigpoint.observers.network import DiffusiveObserver
from trigpoint.simulation.clockwork import ticks
from trigpoint.simulation.plant import Plant
from trigpoint.simulation.scenario import Scenario
from trigpoint.simulation.stacked import Progress, Series, whole


def run(
    observer: DiffusiveObserver,
    plant: Plant,
    scenario: Scenario,
    truth: FloatArray,
    estimate: FloatArray,
    progress: Progress,
) -> Series:
    """``z <- z + g (y_k - g' z) / |g|^2`` for a random column g of G, drawn with probability ``|g|^2 / |G|_F^2``.

    We assume: constants measured directly (A = 0, C = I). The observer's gain plays no part; two messages a tick for an
    internal arc, none for an external one. Source: Strohmer and Vershynin 2009, key StrohmerVershynin2009; theory 6-F5.
    """
    agent, graph = observer.agent, observer.graph
    if agent.A.any() or not np.array_equal(agent.C, np.eye(agent.n_states)):
        raise ArgumentError("gossip is for constants that are measured directly (A = 0, C = I)")
    noise = scenario.noise
    rng, deviation = np.random.default_rng(scenario.seed), 0.0 if noise is None else noise.measurement
    if noise is not None and noise.process > 0.0:
        raise ArgumentError("gossip is for constants: no process noise")
    G = graph.incidence().tocsc()
    squares = np.asarray(G.multiply(G).sum(axis=0)).ravel()
    chance = np.cumsum(squares / squares.sum())
    estimate, messages = estimate.copy(), np.zeros(graph.n_nodes, dtype=np.int64)
    readings = plant.read(truth)
    truths, estimates, counts = [], [], []
    try:
        for tick in progress(ticks(scenario.times, scenario.period or 1.0)):
            for _, late in tick.outputs:
                if late == 0.0:
                    truths.append(truth)
                    estimates.append(estimate.copy())
                    counts.append(messages.copy())
            arc = int(np.searchsorted(chance, rng.random(), side="right"))
            ends, signs = G.indices[G.indptr[arc] : G.indptr[arc + 1]], G.data[G.indptr[arc] : G.indptr[arc + 1]]
            reading = readings[arc] + (deviation * rng.standard_normal(readings.shape[1]) if deviation else 0.0)
            estimate[ends] += signs[:, None] * (reading - signs @ estimate[ends]) / squares[arc]
            if ends.shape[0] == 2:
                messages[ends] += 1
            for _, late in tick.outputs:
                if late > 0.0:
                    truths.append(truth)
                    estimates.append(estimate.copy())
                    counts.append(messages.copy())
    except KeyboardInterrupt:
        if not counts:
            raise
    return whole(truths, estimates, counts)
