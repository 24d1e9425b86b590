"""The verb ``simulate``."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from trigpoint.errors import ArgumentError
from trigpoint.model import NetworkedAgents
from trigpoint.observers.assembled import AssembledObserver, Problem, channels_of
from trigpoint.observers.network import DiffusiveObserver, NetworkObserver
from trigpoint.observers.run import Run
from trigpoint.simulation import modal, programs, stacked
from trigpoint.simulation.clockwork import Tick
from trigpoint.simulation.plant import Plant, node_table
from trigpoint.simulation.scenario import Scenario
from trigpoint.simulation.stacked import Progress


def _silent(ticks: Iterable[Tick]) -> Iterable[Tick]:
    return ticks


def simulate(problem: Problem, observer: NetworkObserver, scenario: Scenario, *, progress: Progress = _silent) -> Run:
    """Run ``observer`` on ``problem`` and record truth and estimates at the scenario's times.

    Paths: ``stacked`` works on all nodes at once; ``modal`` on equal agents mode by mode, with an error estimate in the
    run's attributes; ``reference`` steps each local observer by itself with messages in between and is the oracle.
    ``auto`` takes ``reference`` where messages are lost, ``modal`` above 1500 states where it can, else ``stacked``;
    ``run.path`` names what ran.

    Args:
        problem: the network the truth follows.
        observer: what the nodes run.
        scenario: times, start, exchange, noise.
        progress: wraps the sequence of exchanges, for a progress bar.

    We assume:
        * the observer was designed for these arcs, outputs and agents (its weights are its own).

    Nodes that estimate states of different length are filled up with zeros in the run's tables.

    Raises:
        ArgumentError, ShapeError: the scenario does not fit the problem; noise between exchanges is asked for.
    """
    if not isinstance(problem, Problem) or not isinstance(scenario, Scenario):
        raise ArgumentError(
            "simulate takes a problem (NetworkedAgents, HyperNetwork or SharedPlant), its observer and a "
            f"Scenario(times, ...); got {type(problem).__name__}, {type(observer).__name__}, {type(scenario).__name__}"
        )
    if isinstance(observer, AssembledObserver):
        return _run_programs(problem, observer, scenario, progress)
    if not isinstance(problem, NetworkedAgents):
        raise ArgumentError(f"this observer belongs to a network of agents; got the problem {type(problem).__name__}")
    if not isinstance(observer, DiffusiveObserver):
        raise ArgumentError(f"simulate runs observers made by design(); got {type(observer).__name__}")
    if observer.graph.n_nodes != problem.graph.n_nodes or observer.graph.n_arcs != problem.graph.n_arcs:
        raise ArgumentError(f"the observer belongs to another network: {observer.graph} against {problem.graph}")
    _check_model(problem, observer.problem)
    _check_noise(scenario)
    plant = Plant.of(problem, scenario)
    truth = node_table("initial_state", scenario.initial_state, problem.states)
    estimate = truth + node_table("initial_error", scenario.initial_error, problem.states)
    path, gap = _chosen_path(scenario, observer), None
    if path == "reference":
        truths, estimates, messages = programs.run(observer.as_programs(), scenario, path, progress)
    elif path == "modal":
        (truths, estimates, messages), gap = modal.continuous(observer, plant, scenario, truth, estimate)
    elif scenario.period is None:
        truths, estimates, messages = stacked.continuous(observer, plant, scenario, truth, estimate)
    else:
        truths, estimates, messages = stacked.sampled(observer, plant, scenario, truth, estimate, progress)
    anchored = problem.graph.component_is_anchored[problem.graph.component_labels]
    status = np.broadcast_to(np.where(anchored, "anchored", "relative"), messages.shape)
    return Run(
        scenario.times,
        truths,
        estimates,
        messages,
        status,
        problem.graph.names,
        path,
        _attributes(observer, scenario, gap),
    )


def _run_programs(problem: Problem, observer: AssembledObserver, scenario: Scenario, progress: Progress) -> Run:
    _check_problem(problem, observer)
    path = _chosen_path(scenario, observer)
    truths, estimates, messages = programs.run(observer, scenario, path, progress)
    status = np.broadcast_to("anchored", messages.shape)
    if isinstance(problem, NetworkedAgents):
        anchored = problem.graph.component_is_anchored[problem.graph.component_labels]
        status = np.broadcast_to(np.where(anchored, "anchored", "relative"), messages.shape)
    attributes = {"period": scenario.period or observer.period, **_facts(observer, scenario)}
    return Run(scenario.times, truths, estimates, messages, status, observer.names, path, attributes)


def _check_problem(problem: Problem, observer: AssembledObserver) -> None:
    if observer.problem is problem:
        return
    one, other = channels_of(problem), observer.channels
    same = one.names == other.names and one.readings == other.readings and one.A.shape == other.A.shape
    if not (same and (one.A != other.A).nnz == 0 and (one.C != other.C).nnz == 0):
        raise ArgumentError("the observer belongs to another problem: its names, dynamics or outputs differ")


def _chosen_path(scenario: Scenario, observer: NetworkObserver) -> str:
    """The rule: messages that get lost need ``reference``, many equal agents take ``modal``, all else ``stacked``."""
    lossy = scenario.channel is not None and scenario.channel.loss > 0.0
    if scenario.path == "stacked" and lossy:
        raise ArgumentError("the stacked path knows no message loss; use path='reference' or 'auto'")
    splits = isinstance(observer, DiffusiveObserver) and observer.graph.dimension == 1 and scenario.period is None
    if scenario.path == "modal" and not splits:
        raise ArgumentError(
            "the modal path is for equal agents with one gain, scalar weights and continuous exchange; use path='auto'"
        )
    if scenario.path != "auto":
        return scenario.path
    if lossy:
        return "reference"
    return "modal" if splits and observer.error_matrix().shape[0] > stacked.DENSE_LIMIT else "stacked"


def _check_model(problem: NetworkedAgents, designed: NetworkedAgents) -> None:
    """The error dynamics that both paths rest on hold for the observer's own model only."""
    if designed is problem:
        return
    own, other = problem.graph, designed.graph
    if not (np.array_equal(own.tail, other.tail) and np.array_equal(own.head, other.head)):
        raise ArgumentError("the observer belongs to another network: its arcs join other nodes")
    for node, (agent, model) in enumerate(zip(problem.agents, designed.agents, strict=True)):
        pairs = ((agent.A, model.A), (agent.C, model.C), (agent.B, model.B))
        if not all(a is b or np.array_equal(np.asarray(a), np.asarray(b)) for a, b in pairs):
            raise ArgumentError(f"the observer belongs to other agents: node {own.names[node]!r} has another A, B or C")


def _check_noise(scenario: Scenario) -> None:
    if scenario.noise is None or scenario.noise.process == 0.0 or scenario.period is None:
        return
    ratio = scenario.times / scenario.period
    if np.abs(ratio - np.round(ratio)).max() > 1e-9:
        raise ArgumentError("with process noise the output times must be multiples of the period")


def _attributes(observer: DiffusiveObserver, scenario: Scenario, gap: float | None) -> dict[str, Any]:
    known = {"gain": observer.gain, "period": scenario.period, **_facts(observer, scenario)}
    return known if gap is None else {**known, "error_estimate": gap}


def _facts(observer: NetworkObserver, scenario: Scenario) -> dict[str, Any]:
    noise, channel = scenario.noise, scenario.channel
    return {
        "method": observer.method,
        # The guarantee speaks of continuous exchange: a sampled or noisy run carries none.
        "guaranteed_rate": observer.decay_rate if scenario.period is None else None,
        "seed": scenario.seed,
        "noise_measurement": 0.0 if noise is None else noise.measurement,
        "noise_process": 0.0 if noise is None else noise.process,
        "loss": 0.0 if channel is None else channel.loss,
    }
