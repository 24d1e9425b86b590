"""Axioms that every network observer obeys, each an ``AssertionError`` with the numbers when it fails."""

from __future__ import annotations

import json
from typing import Any

import numpy as np

from trigpoint.methods import Method, design
from trigpoint.observers.assembled import AssembledObserver, Problem
from trigpoint.observers.local import LocalObserver, Message
from trigpoint.observers.network import DiffusiveObserver, NetworkObserver
from trigpoint.simulation import Scenario, simulate

_TOLERANCE = 1e-9


def check_observer(problem: Problem, observer: NetworkObserver, seed: int = 0) -> None:
    """Check the axioms of an observer on its own problem.

    * the design equations W17 (5), (8) hold to 1e-12;
    * the rows assembled from the local programs are the error matrix;
    * every local program survives its node file, keeps nothing on itself and stays finite when everything outside
      its neighbourhood is NaN (poison test);
    * node-by-node and stacked execution agree to 1e-9, in continuous and in sampled time.

    Args:
        problem: what is estimated; at most some tens of nodes (the reference path is slow).
        observer: the observer to check.
        seed: of the drawn states.
    """
    residuals = observer.verify_design_equations()
    assert residuals.dynamics <= 1e-12, f"W17 (5) violated by {residuals.dynamics:.3g}"
    assert residuals.output <= 1e-12, f"W17 (8) violated by {residuals.output:.3g}"
    difference = np.abs((observer.general_form().H - observer.error_matrix()).toarray()).max(initial=0.0)
    size = float(np.abs(observer.error_matrix().toarray()).max(initial=1.0))
    assert difference <= 1e-12 * size, f"local rows and error matrix differ by {difference:.3g}"
    rng = np.random.default_rng(seed)
    nodes = [observer.local(node) for node in range(len(observer.names))]
    readings = {label: rows for node in nodes for label, rows in _reading_sizes(node).items()}
    for node in nodes:
        _check_local(node, {other.name: other.n_states for other in nodes}, readings, rng)
    if isinstance(observer, DiffusiveObserver | AssembledObserver):
        _check_paths(problem, observer, rng)


def check_design(method: Method, problem: Problem) -> NetworkObserver:
    """Design and check: the axioms of ``check_observer``, and a computed decay no slower than the guaranteed one.

    Args:
        method: the design method.
        problem: a problem that it accepts.
    """
    observer = design(problem, method)
    check_observer(problem, observer)
    if observer.spectral_abscissa is not None:
        slack = _TOLERANCE * max(1.0, abs(observer.spectral_abscissa))
        assert observer.spectral_abscissa <= -observer.decay_rate + slack, (
            f"guaranteed rate {observer.decay_rate:.6g}, but the spectrum reaches {observer.spectral_abscissa:.6g}"
        )
    return observer


def _reading_sizes(local: LocalObserver) -> dict[int, int]:
    """How many numbers each reading has that the program uses."""
    sizes = {arc.label: arc.output.shape[0] for arc in local.arcs if arc.label is not None}
    return {**sizes, **{label: matrix.shape[1] for label, matrix in local.feedthrough}}


def _check_local(local: LocalObserver, sizes: dict[str, int], rows: dict[int, int], rng: np.random.Generator) -> None:
    everyone = {name: Message(name, 0, 0.0, np.full(n, np.nan)) for name, n in sizes.items()}
    own = {name: Message(name, 0, 0.0, rng.normal(size=sizes[name])) for name in local.hears}
    poison = {label: np.full(p, np.nan) for label, p in rows.items()}
    readings: dict[int, Any] = {label: rng.normal(size=rows[label]) for label in local.reads}
    state = local.init(rng.normal(size=local.n_states))
    clean = local.step(state, own, readings, 0.1)
    mixed = local.step(state, {**everyone, **own}, {**poison, **readings}, 0.1)
    assert np.isfinite(mixed.estimate).all(), f"node {local.name} uses something outside its neighbourhood"
    assert np.array_equal(clean.estimate, mixed.estimate), f"node {local.name} depends on more than its neighbours"
    again = LocalObserver.from_document(_through_text(local.to_document())).step(state, own, readings, 0.1)
    assert np.array_equal(clean.estimate, again.estimate), f"node {local.name}: its file describes another program"
    silent = local.step(state, {}, {}, 0.1)
    assert np.isfinite(silent.estimate).all(), f"node {local.name} cannot do without messages"


def _through_text(document: dict[str, Any]) -> Any:
    return json.loads(json.dumps(document))


def _check_paths(problem: Problem, observer: DiffusiveObserver | AssembledObserver, rng: np.random.Generator) -> None:
    rate = max(abs(observer.spectral_abscissa or 1.0), 1e-3)
    periods: tuple[float | None, ...] = (None, 0.125 / rate)
    if isinstance(observer, AssembledObserver) and (observer.period is not None or observer.is_discrete):
        periods = (0.125 / rate if observer.period is None else observer.period,)
    sizes = [observer.local(node).estimate(observer.local(node).init()).shape[0] for node in range(len(observer.names))]
    total = observer.channels.A.shape[0] if isinstance(observer, AssembledObserver) else sum(sizes)
    start, error = rng.normal(size=total), rng.normal(size=sum(sizes))
    for period in periods:
        times = np.array([0.0, 2.0, 8.0]) * (0.125 / rate if period is None else period)
        runs = [
            simulate(problem, observer, Scenario(times, error, start, period=period, path=path))
            for path in ("stacked", "reference")
        ]
        size = max(float(np.abs(run.estimate).max()) for run in runs)
        gap = float(np.abs(runs[0].estimate - runs[1].estimate).max())
        assert gap <= _TOLERANCE * max(size, 1.0), f"stacked and reference paths differ by {gap:.3g} (period {period})"
