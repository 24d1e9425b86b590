"""Drawn small problems against exact truth: nothing false is certified, nothing true refuted, little left open."""

from __future__ import annotations

import dataclasses
from collections import Counter
from collections.abc import Callable

import numpy as np
import pytest
import scipy.linalg as la

import trigpoint as tp
from tests.certificates.delays import crossings, is_stable_with
from tests.certificates.exact import (
    PI_ABOVE,
    PI_BELOW,
    Pair,
    decays_faster,
    decreases,
    exact,
    have_a_common_function,
    largest_is_below,
    smallest_is_above,
)
from tests.certificates.exact import modes as exact_modes
from tests.certificates.oracle import AGENTS, drawn_graph
from trigpoint.certificates import Convergence, DelayMargin, SmallestEigenvalue, SwitchingStability
from trigpoint.observers.network import DiffusiveObserver

Judged = tuple[str, bool]
"""An outcome, and whether the claim is true."""


def _distance(rng: np.random.Generator, condition: float = 1.0) -> float:
    """A relative distance from the edge on either side, outside the band of 1e-9 times the condition."""
    return float(rng.choice([-1.0, 1.0])) * condition * 10.0 ** rng.uniform(-9.0, -0.5)


def _observer(rng: np.random.Generator, agent: tp.LinearAgent, decades: float = 1.0) -> DiffusiveObserver:
    problem = tp.NetworkedAgents(drawn_graph(rng, int(rng.integers(1, 5)), decades), agent)
    injection = rng.uniform(0.3, 1.5, (agent.n_states, agent.C.shape[0]))
    return DiffusiveObserver("drawn", problem, injection, float(rng.uniform(0.3, 3.0)), 0.1, None, {})


def _values(observer: DiffusiveObserver) -> np.ndarray:
    return np.linalg.eigvalsh(observer.graph.laplacian().toarray())


def smallest(rng: np.random.Generator) -> Judged:
    """Bounds with one of them near the truth."""
    observer = _observer(rng, AGENTS["static"])
    value, record = float(_values(observer)[0]), SmallestEigenvalue().check(observer.problem, observer)
    near = value * (1.0 + _distance(rng))
    lower, upper = (near, 2.0 * max(value, near)) if rng.random() < 0.5 else (0.5 * min(value, near), near)
    true = smallest_is_above(observer.graph, exact(lower)) and not smallest_is_above(observer.graph, exact(upper))
    forged = dataclasses.replace(record, numbers={"lower": lower, "upper": upper})
    return SmallestEigenvalue.verify(forged, observer.problem, observer), true


def convergence(rng: np.random.Generator) -> Judged:
    """A rate near the true one, for static and moving agents, of observers that no method designed."""
    names = sorted(AGENTS)
    observer = _observer(rng, AGENTS[names[int(rng.integers(len(names)))]], 0.5)
    values, left = np.linalg.eig(observer.error_matrix().toarray().T)
    slowest = int(np.argmax(values.real))
    right = np.linalg.inv(left.T)[:, slowest]
    condition = float(np.linalg.norm(right) * np.linalg.norm(left[:, slowest]))
    true = -float(values.real[slowest])
    distance = _distance(rng, min(condition * float(np.abs(values).max()) / (abs(true) or 1.0), 1e8))
    rate = abs(true * (1.0 + distance))
    return Convergence(rate=rate).check(observer.problem, observer).verdict, decays_faster(observer, exact(rate))


def switching(rng: np.random.Generator) -> Judged:
    """Unstable scalar agents: every topology decays exactly when ``gain floor k c > a``."""
    observer = _observer(rng, AGENTS["unstable"])
    agent = observer.agent
    edge = agent.A.item() / (observer.gain * observer.injection.item() * agent.C.item())
    floor = edge * (1.0 + _distance(rng))
    record = SwitchingStability(floor=floor, ceiling=10.0 * floor).check(observer.problem, observer)
    pull = exact(observer.gain) * exact(observer.injection.item()) * exact(agent.C.item())
    return record.verdict, pull * exact(floor) > exact(agent.A.item())


def common_function(rng: np.random.Generator) -> Judged:
    """A rate near the one at which a given P decreases along agents of two states, at both ends of a range."""
    claim = SwitchingStability(floor=1.0, ceiling=float(10.0 ** rng.uniform(0.01, 1.0)))
    observer = _second_order(rng)
    while (record := claim.check(observer.problem, observer)).verdict != "certified":
        observer = _second_order(rng)
    P = record.witness["P"]
    ends = (record.numbers["floor"], record.numbers["ceiling"])
    pull = observer.injection @ observer.agent.C
    modes = [observer.agent.A - observer.gain * end * pull for end in ends]
    best = min(float(la.eigh(-(P @ F + F.T @ P), P, eigvals_only=True)[0]) / 2.0 for F in modes)
    condition = float(np.linalg.cond(P) * max(np.linalg.norm(F) for F in modes)) / (abs(best) or 1.0)
    rate = abs(best * (1.0 + _distance(rng, min(condition, 1e8))))
    forged = dataclasses.replace(record, numbers={**record.numbers, "rate": rate}, witness={"P": P})
    true = decreases(P, exact_modes(observer, ends, rate))
    outcome = SwitchingStability.verify(forged, observer.problem, observer)
    return ("refuted" if outcome == "inconclusive" and not true else outcome), true  # for this P it can say no more


def _second_order(rng: np.random.Generator) -> DiffusiveObserver:
    agents = [AGENTS[name] for name in ("double integrator", "oscillator", "driven oscillator")]
    agent = agents[int(rng.integers(len(agents)))] if rng.random() < 0.5 else None
    agent = agent or tp.LinearAgent(rng.normal(size=(2, 2)), rng.normal(size=(1, 2)))
    problem = tp.NetworkedAgents(tp.graphs.chain(2), agent)
    return DiffusiveObserver("drawn", problem, rng.normal(size=(2, 1)), float(rng.uniform(0.3, 3.0)), 0.1, None, {})


def range_of_two_states(rng: np.random.Generator) -> Judged:
    """Agents of two states, and a floor near the one below which no common function exists, or a mode grows."""
    ceiling = float(10.0 ** rng.uniform(-0.5, 1.0))
    observer = _second_order(rng)
    while not have_a_common_function(exact_modes(observer, (ceiling, ceiling))):
        observer = _second_order(rng)
    low, high = 1e-3 * ceiling, ceiling
    for _ in range(50):
        middle = float(np.sqrt(low * high))
        there = have_a_common_function(exact_modes(observer, (middle, ceiling)))
        low, high = (low, middle) if there else (middle, high)
    floor = min(high * (1.0 + _distance(rng)), ceiling)
    record = SwitchingStability(floor=floor, ceiling=ceiling).check(observer.problem, observer)
    ends = exact_modes(observer, (floor, ceiling))
    if record.verdict == "inconclusive" and not have_a_common_function(ends) and _are_stable(ends):
        return "refuted", False  # every mode decays and no one function does: there is nothing to prove
    rate = record.numbers["rate"] if record.verdict == "certified" else 0.0
    true = have_a_common_function(exact_modes(observer, (floor, ceiling), rate))
    return record.verdict, true if record.verdict != "refuted" else _are_stable(ends)


def _are_stable(pair: Pair) -> bool:
    return all(have_a_common_function((F, F)) for F in pair)


def delay(rng: np.random.Generator) -> Judged:
    """Constants: stable exactly where ``2 gain k lambda_max delay < pi``."""
    observer = _observer(rng, AGENTS["static"])
    k = observer.injection.item()
    late = np.pi / (2.0 * observer.gain * k * float(_values(observer)[-1])) * (1.0 + _distance(rng))
    factor = 2 * exact(observer.gain) * exact(k) * exact(late)
    true = largest_is_below(observer.graph, PI_BELOW / factor)
    assert true == largest_is_below(observer.graph, PI_ABOVE / factor)
    return DelayMargin(late).check(observer.problem, observer).verdict, true


def late_agents(rng: np.random.Generator) -> Judged:
    """Agents that move: a delay near the first at which a root of some mode meets the imaginary axis."""
    names = ["decaying", "unstable", "double integrator", "oscillator", "driven oscillator"]
    observer = _observer(rng, AGENTS[names[int(rng.integers(len(names)))]], 0.5)
    while not (decays_faster(observer, exact(0.0)) and (found := crossings(observer))):
        observer = _observer(rng, AGENTS[names[int(rng.integers(len(names)))]], 0.5)
    late = float(min(first for first, _, _ in found)) * (1.0 + _distance(rng))
    return DelayMargin(late).check(observer.problem, observer).verdict, is_stable_with(found, late)


KINDS: dict[str, Callable[[np.random.Generator], Judged]] = {
    "smallest-eigenvalue": smallest,
    "convergence": convergence,
    "switching-stability": switching,
    "switching-stability, two states": range_of_two_states,
    "switching-stability, two states, a given function": common_function,
    "delay-margin": delay,
    "delay-margin, agents that move": late_agents,
}


def judged(count: int, seed: int) -> dict[str, Counter[str]]:
    """Draw ``count`` problems, as many for each claim, and count the outcomes; a wrong one fails."""
    rng = np.random.default_rng(seed)
    seen: dict[str, Counter[str]] = {name: Counter() for name in KINDS}
    for k in range(count):
        name = list(KINDS)[k % len(KINDS)]
        outcome, true = KINDS[name](rng)
        assert outcome != ("refuted" if true else "certified"), (name, k, seed)
        seen[name][outcome] += 1
    return seen


def test_drawn_problems_are_never_judged_wrongly() -> None:
    for name, outcomes in judged(400, 0).items():
        assert outcomes["inconclusive"] <= 4, (name, outcomes)
        assert min(outcomes["certified"], outcomes["refuted"]) >= 10, (name, outcomes)


@pytest.mark.slow
def test_a_hundred_thousand_problems_are_never_judged_wrongly(capsys: pytest.CaptureFixture[str]) -> None:
    seen = judged(100_000, 1)
    with capsys.disabled():
        for name, outcomes in seen.items():
            total = sum(outcomes.values())
            print(f"\n{name}: {dict(outcomes)}, inconclusive {100.0 * outcomes['inconclusive'] / total:.3f} %", end="")
            assert outcomes["inconclusive"] < 0.01 * total
