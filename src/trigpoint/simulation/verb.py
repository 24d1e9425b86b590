"""The verb ``simulate``."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from trigpoint.arrays import FloatArray
from trigpoint.errors import ArgumentError
from trigpoint.model import NetworkedAgents
from trigpoint.observers.assembled import AssembledObserver, Problem, channels_of
from trigpoint.observers.network import DiffusiveObserver, NetworkObserver
from trigpoint.observers.run import Run
from trigpoint.simulation import gossip, modal, programs, stacked, switched
from trigpoint.simulation.clockwork import Tick
from trigpoint.simulation.exchanges import Recorded, Traffic
from trigpoint.simulation.plant import Plant, node_table
from trigpoint.simulation.result import recorded
from trigpoint.simulation.rule import changes, chosen_path
from trigpoint.simulation.scenario import Scenario
from trigpoint.simulation.stacked import Progress, Series


def _silent(ticks: Iterable[Tick]) -> Iterable[Tick]:
    return ticks


def simulate(problem: Problem, observer: NetworkObserver, scenario: Scenario, *, progress: Progress = _silent) -> Run:
    """Run ``observer`` on ``problem`` and record truth and estimates at the scenario's times.

    Paths (``simulation.rule.chosen_path`` is the rule, ``run.path`` names what ran): ``stacked`` works on all nodes at
    once; ``modal`` on equal agents mode by mode, exactly between changes, with an error estimate in the run's
    attributes; ``reference`` steps each local observer by itself with messages in between and is the oracle.

    Args:
        problem: the network the truth follows.
        observer: what the nodes run.
        scenario: times, start, exchange, noise, channel, topology, motion.
        progress: wraps the sequence of exchanges, for a progress bar.

    We assume:
        * the observer was designed for these arcs, outputs and agents (its weights are its own).

    Nodes that estimate states of different length are filled up with zeros in the run's tables. Ctrl-C in a sampled run
    returns what was computed by then (``run.attributes["interrupted"]``).

    Raises:
        ArgumentError, ShapeError: the scenario does not fit the problem.
    """
    if not isinstance(problem, Problem) or not isinstance(scenario, Scenario):
        raise ArgumentError(
            "simulate takes a problem (NetworkedAgents, HyperNetwork or SharedPlant), its observer and a "
            f"Scenario(times, ...); got {type(problem).__name__}, {type(observer).__name__}, {type(scenario).__name__}"
        )
    if isinstance(observer, AssembledObserver):
        check_problem(problem, observer)
        path = chosen_path(scenario, observer)
        return recorded(problem, observer, scenario, path, programs.run(observer, scenario, path, progress))
    if not isinstance(problem, NetworkedAgents):
        raise ArgumentError(f"this observer belongs to a network of agents; got the problem {type(problem).__name__}")
    if not isinstance(observer, DiffusiveObserver):
        raise ArgumentError(f"simulate runs observers made by design(); got {type(observer).__name__}")
    if observer.graph.n_nodes != problem.graph.n_nodes or observer.graph.n_arcs != problem.graph.n_arcs:
        raise ArgumentError(f"the observer belongs to another network: {observer.graph} against {problem.graph}")
    _check_model(problem, observer.problem)
    _check_noise(scenario)
    path = chosen_path(scenario, observer)
    if path == "reference" or _by_programs(scenario):
        done = programs.run(observer.as_programs(), scenario, path, progress)
        return recorded(problem, observer, scenario, path, done)
    plant = Plant.of(problem, scenario)
    truth = node_table("initial_state", scenario.initial_state, problem.states)
    if scenario.motion is not None:
        truth = node_table("the motion's states", scenario.motion.at(0.0), problem.states)
    estimate = truth + node_table("initial_error", scenario.initial_error, problem.states)
    series, engines = _run_at_once(observer, plant, scenario, (truth, estimate), path, progress)
    return recorded(problem, observer, scenario, path, Recorded(series[0], series[1], Traffic(series[2])), engines)


def _by_programs(scenario: Scenario) -> bool:
    """Sampled runs whose messages are late, rounded, or whose truth is given."""
    return scenario.period is not None and (scenario.channel is not None or scenario.motion is not None)


def _run_at_once(
    observer: DiffusiveObserver,
    plant: Plant,
    scenario: Scenario,
    start: tuple[FloatArray, FloatArray],
    path: str,
    progress: Progress,
) -> tuple[Series, modal.Engines | None]:
    if path == "gossip":
        return gossip.run(observer, plant, scenario, *start, progress), None
    if scenario.period is not None:
        return stacked.sampled(observer, plant, scenario, *start, progress), None
    if path != "modal":
        return stacked.continuous(observer, plant, scenario, *start), None
    if changes(scenario):
        return switched.continuous(observer, plant, scenario, *start)
    return modal.continuous(observer, plant, scenario, *start)


def check_problem(problem: Problem, observer: AssembledObserver) -> None:
    """Refuse an ``observer`` that belongs to another ``problem``."""
    if observer.problem is problem:
        return
    one, other = channels_of(problem), observer.channels
    same = one.names == other.names and one.readings == other.readings and one.A.shape == other.A.shape
    if not (same and (one.A != other.A).nnz == 0 and (one.C != other.C).nnz == 0):
        raise ArgumentError("the observer belongs to another problem: its names, dynamics or outputs differ")


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
