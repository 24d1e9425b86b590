"""Axioms that every network observer obeys, each an ``AssertionError`` with the numbers when it fails."""

from __future__ import annotations

import json
from typing import Any

import numpy as np

from trigpoint.methods import Method, design
from trigpoint.model import NetworkedAgents
from trigpoint.observers.local import LocalObserver, Message
from trigpoint.observers.network import DiffusiveObserver, NetworkObserver
from trigpoint.simulation import Scenario, simulate

_TOLERANCE = 1e-9


def check_observer(problem: NetworkedAgents, observer: NetworkObserver, seed: int = 0) -> None:
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
    for node in range(observer.graph.n_nodes):
        _check_local(observer.local(node), observer, rng)
    if isinstance(observer, DiffusiveObserver):
        _check_paths(problem, observer, rng)


def check_design(method: Method, problem: NetworkedAgents) -> NetworkObserver:
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


def _check_local(local: LocalObserver, observer: NetworkObserver, rng: np.random.Generator) -> None:
    n = local.n_states
    everyone = {name: Message(name, 0, 0.0, np.full(n, np.nan)) for name in observer.graph.names}
    own = {name: Message(name, 0, 0.0, rng.normal(size=n)) for name in local.hears}
    p = observer.general_form().K.shape[1] // max(observer.graph.n_arcs, 1)
    poison = {k: np.full(p, np.nan) for k in range(observer.graph.n_arcs)}
    readings = {arc.label: np.asarray(rng.normal(size=arc.output.shape[0])) for arc in local.arcs}
    state = local.init(rng.normal(size=n))
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


def _check_paths(problem: NetworkedAgents, observer: DiffusiveObserver, rng: np.random.Generator) -> None:
    shape = (problem.states.count, problem.states.size)
    start, error = rng.normal(size=shape), rng.normal(size=shape)
    rate = max(abs(observer.spectral_abscissa or 1.0), 1e-3)
    times = np.array([0.0, 0.25, 1.0]) / rate
    for period in (None, 0.125 / rate):
        runs = [
            simulate(problem, observer, Scenario(times, error, start, period=period, path=path))
            for path in ("stacked", "reference")
        ]
        size = max(float(np.abs(run.estimate).max()) for run in runs)
        gap = float(np.abs(runs[0].estimate - runs[1].estimate).max())
        assert gap <= _TOLERANCE * max(size, 1.0), f"stacked and reference paths differ by {gap:.3g} (period {period})"
