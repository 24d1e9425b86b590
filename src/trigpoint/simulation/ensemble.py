"""Many runs, or many networks, at once: sampled errors under noise and lost arcs over runs, modes over networks."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any, Literal, get_args

import numpy as np
import scipy.sparse as sp

from trigpoint.arrays import FloatArray, IntArray
from trigpoint.errors import ArgumentError, MissingExtraError
from trigpoint.linalg.blocks import Ranges, diagonal_of
from trigpoint.observers.assembled import AssembledObserver, Problem
from trigpoint.observers.network import DiffusiveObserver, NetworkObserver
from trigpoint.simulation.exchanges import ArcForm
from trigpoint.simulation.scenario import Noise, Scenario
from trigpoint.simulation.verb import check_problem
from trigpoint.simulation.world import World, start_of

Engine = Literal["numpy", "jax"]
CHUNK = 128
"""Runs that are stepped together; each chunk has a seed of its own, so that workers do not change a bit."""

_LARGEST = 3000
_STRETCH = 64


@dataclass(frozen=True, eq=False)
class Ensemble:
    """Statistics of the error over many runs.

    Attributes:
        times: (T,) seconds.
        node_mean_square: (T, N) mean over the runs of ``|e_i|^2``.
        mean_square: (T,) mean of ``|e|^2``.
        standard_error: (T,) of ``mean_square``, from the spread of the runs.
        covariance: (n_z, n_z) second moment of the whole error at the last time.
        runs: how many.
    """

    times: FloatArray
    node_mean_square: FloatArray
    mean_square: FloatArray
    standard_error: FloatArray
    covariance: FloatArray
    runs: int


def ensemble(
    problem: Problem,
    observer: NetworkObserver,
    scenario: Scenario,
    runs: int,
    *,
    arrival: float = 1.0,
    workers: int | None = None,
    engine: Engine = "numpy",
) -> Ensemble:
    """Simulate the error ``runs`` times: noise and lost arcs are drawn anew for each.

    Args:
        problem: what is estimated.
        observer: what the nodes run.
        scenario: period, times (multiples of it), initial error, noise and seed; nothing else may be set.
        runs: number of runs.
        arrival: probability with which each arc works at each exchange (theory 6-F4).
        workers: threads; all cores unless given. The result does not depend on it.
        engine: ``numpy``, or ``jax`` (extra ``jax``; the same draws, compiled; on an accelerator where JAX finds one).

    We assume: the design equations hold, so that the error moves by itself; with ``arrival < 1`` an exchange whose map
    does not depend on who is heard (``euler``, ``innovation-held``, ``discrete``).

    Raises:
        ArgumentError: a scenario or an observer that this does not cover.
    """
    return ensembles([(problem, observer)], scenario, runs, arrival=arrival, workers=workers, engine=engine)[0]


def ensembles(
    networks: Sequence[tuple[Problem, NetworkObserver]],
    scenario: Scenario,
    runs: int,
    *,
    arrival: float = 1.0,
    workers: int | None = None,
    engine: Engine = "numpy",
) -> list[Ensemble]:
    """Many networks in one call, all cores: each as ``ensemble`` would do it alone, to the last bit.

    Args: ``networks`` are (problem, observer) pairs of any sizes; ``scenario``, ``runs``, ``arrival``, ``workers`` and
    ``engine`` as in ``ensemble``, the same for all. Raises as ``ensemble`` does.
    """
    jobs, sizes = [], []
    for problem, observer in networks:
        chosen = observer.as_programs() if isinstance(observer, DiffusiveObserver) else observer
        if not isinstance(chosen, AssembledObserver):
            raise ArgumentError(f"an ensemble runs observers made by design(); got {type(observer).__name__}")
        check_problem(problem, chosen)
        steps = _check(chosen, scenario, runs, arrival, engine)
        model, states = _Model.of(chosen, scenario, arrival), chosen.states
        counts = [min(CHUNK, runs - first) for first in range(0, runs, CHUNK)]
        seeds = np.random.SeedSequence(scenario.seed).spawn(len(counts))
        jobs += [(model, count, seed, steps) for count, seed in zip(counts, seeds, strict=True)]
        sizes.append((states, len(counts)))
    advance: Callable[[_Model, int, np.random.SeedSequence, list[int]], FloatArray]
    advance = _numpy_chunk if engine == "numpy" else _jax_chunk()
    found: list[Ensemble] = []
    with ThreadPoolExecutor(workers or os.cpu_count() or 1) as pool:
        parts = pool.map(lambda job: advance(*job), jobs)
        for states, count in sizes:
            found.append(_statistics(scenario, states, [next(parts) for _ in range(count)], runs))
    return found


@dataclass(frozen=True, eq=False)
class _Model:
    """``e+ = T e + F (mask (R e + S v)) - W w`` for one exchange; v and w are standard normal.

    Attributes:
        start: (n_z,) first error.
        T, F, R, S, W: the matrices, sparse; those of noise have no column where there is none.
        arrival: chance of each label's rows.
        label: (rows,) which arc each row belongs to, -1 for none.
    """

    start: FloatArray
    T: sp.csr_array
    F: sp.csr_array
    R: sp.csr_array
    S: sp.csr_array
    W: sp.csr_array
    arrival: float
    label: IntArray

    @staticmethod
    def of(observer: AssembledObserver, scenario: Scenario, arrival: float) -> _Model:
        period = scenario.period if scenario.period is not None else observer.period
        assert period is not None  # checked before
        world, form = World.of(observer, scenario), ArcForm.of(observer)
        maps = [node.maps(period) for node in observer.nodes]
        transition, phi = diagonal_of(each[0] for each in maps), diagonal_of(each[2] for each in maps)
        errors = start_of(world, "initial_error", scenario.initial_error)
        noise = Noise() if scenario.noise is None else scenario.noise
        target, reading = observer.target_matrix(), noise.measurement * form.reading
        pushes = target @ diagonal_of(world.noise_factors(noise.process, period)) if noise.process else target[:, :0]
        labels = [
            -1 if arc.label is None else arc.label
            for node in observer.nodes
            for arc in node.arcs
            for _ in range(arc.output.shape[0])
        ]
        return _Model(
            np.concatenate([observer.target(k) @ error for k, error in enumerate(errors)]),
            sp.csr_array(transition),
            sp.csr_array(phi @ form.gain),
            sp.csr_array(form.own + form.other),
            sp.csr_array(reading if noise.measurement else reading[:, :0]),
            sp.csr_array(pushes),
            arrival,
            np.array(labels, dtype=np.int64),
        )

    def draws(self, runs: int, rng: np.random.Generator) -> tuple[FloatArray, FloatArray, FloatArray]:
        """One exchange's v, w and, for every label and then for none, 1 where it works; for all ``runs``."""
        v = rng.standard_normal((self.S.shape[1], runs))
        w = rng.standard_normal((self.W.shape[1], runs))
        works = np.ones((int(self.label.max(initial=-1)) + 2, runs))
        if self.arrival < 1.0:
            works[:-1] = rng.random((len(works) - 1, runs)) < self.arrival
        return v, w, works


def _check(observer: AssembledObserver, scenario: Scenario, runs: int, arrival: float, engine: str) -> list[int]:
    period = scenario.period if scenario.period is not None else observer.period
    if period is None:
        raise ArgumentError("an ensemble is for sampled exchange: give the scenario a period")
    if runs < 2 or not 0.0 < arrival <= 1.0 or engine not in get_args(Engine):
        raise ArgumentError(
            f"an ensemble needs runs >= 2, 0 < arrival <= 1, engine numpy or jax; got {runs}, {arrival}, {engine!r}"
        )
    others = ("channel", "clocks", "topology", "trigger", "motion", "measurements")
    given = [name for name in others if getattr(scenario, name) is not None]
    if given or scenario.absences or scenario.gossip:
        raise ArgumentError(f"an ensemble covers noise and lost arcs; got {', '.join(given) or 'absences or gossip'}")
    if arrival < 1.0 and any(node.exchange == "held" or node.acceleration for node in observer.nodes):
        raise ArgumentError("with lost arcs the exchange must not depend on who is heard: use Sampled(form='euler')")
    if observer.states.total > _LARGEST:
        raise ArgumentError(f"an ensemble takes at most {_LARGEST} states; got {observer.states.total}")
    ratio = scenario.times / period
    if np.abs(ratio - np.round(ratio)).max() > 1e-9:
        raise ArgumentError("times of an ensemble must be multiples of the period")
    return [int(value) for value in np.round(ratio)]


def _numpy_chunk(model: _Model, runs: int, seed: np.random.SeedSequence, steps: list[int]) -> FloatArray:
    """(T, n_z, runs) errors at the output steps."""
    rng, error, kept = np.random.default_rng(seed), np.repeat(model.start[:, None], runs, axis=1), []
    wanted = set(steps)
    for number in range(steps[-1] + 1):
        if number in wanted:
            kept.append(error)
        v, w, works = model.draws(runs, rng)
        innovation = model.R @ error + model.S @ v
        if model.arrival < 1.0:
            innovation *= works[model.label]
        error = model.T @ error + model.F @ innovation - model.W @ w
    return np.stack(kept)


def _jax_chunk() -> Callable[[_Model, int, np.random.SeedSequence, list[int]], FloatArray]:
    try:
        import jax
    except ImportError as error:
        raise MissingExtraError("jax", "jax", "engine='jax'") from error
    jax.config.update("jax_enable_x64", True)  # type: ignore[no-untyped-call, unused-ignore]

    @jax.jit  # type: ignore[untyped-decorator, unused-ignore]
    def stretch(error: Any, matrices: Any, label: Any, draws: Any) -> Any:
        T, F, R, S, W = matrices

        def step(now: Any, drawn: Any) -> tuple[Any, None]:
            v, w, works = drawn
            return T @ now + F @ (works[label] * (R @ now + S @ v)) - W @ w, None

        return jax.lax.scan(step, error, draws)[0]

    def chunk(model: _Model, runs: int, seed: np.random.SeedSequence, steps: list[int]) -> FloatArray:
        rng, error, kept = np.random.default_rng(seed), np.repeat(model.start[:, None], runs, axis=1), []
        # Dense: what an accelerator is made for, and a few thousand states at most.
        matrices = [jax.device_put(each.toarray()) for each in (model.T, model.F, model.R, model.S, model.W)]
        done = 0
        for number in steps:
            while done < number:
                count = min(_STRETCH, number - done)
                drawn = zip(*(model.draws(runs, rng) for _ in range(count)), strict=True)
                error = stretch(error, matrices, model.label, tuple(map(np.stack, drawn)))
                done += count
            kept.append(np.asarray(error))
        return np.stack(kept)

    return chunk


def _statistics(scenario: Scenario, states: Ranges, parts: list[FloatArray], runs: int) -> Ensemble:
    squares = np.concatenate([(part**2).sum(axis=1) for part in parts], axis=1)
    by_state = sum((part**2).sum(axis=2) for part in parts) / runs
    nodes = np.stack([by_state[:, states.slice(k)].sum(axis=1) for k in range(states.count)], axis=1)
    last = sum(part[-1] @ part[-1].T for part in parts) / runs
    return Ensemble(
        scenario.times,
        nodes,
        squares.mean(axis=1),
        squares.std(axis=1, ddof=1) / np.sqrt(runs),
        np.asarray(last),
        runs,
    )
