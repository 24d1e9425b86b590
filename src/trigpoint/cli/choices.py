"""From the words of a ``[design]`` table or the command line to a design method: one row a method."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, get_args

import numpy as np

from trigpoint.cli.places import PlacedError
from trigpoint.io.sections import DesignSection
from trigpoint.io.text import nearest
from trigpoint.methods import (
    Accelerated,
    BraschPearson,
    Centralised,
    CouplingGain,
    DiscreteKalman,
    Fixed,
    FromGraph,
    GainRule,
    Heterogeneous,
    IntegratorObserver,
    LocalKalman,
    Method,
    ProjectedConsensus,
    Sampled,
    SccCascade,
    SpectrumAssignment,
    WorstCase,
)
from trigpoint.methods.accelerated import Scheme
from trigpoint.methods.centralised import Kind
from trigpoint.methods.sampled import Form
from trigpoint.model import NetworkedAgents, SharedPlant

_GAIN = ("gain", "margin", "max_nodes")
_COVARIANCES = ("process", "measurement")
_EVERYWHERE = {"method", "weights"}


@dataclass(frozen=True)
class Row:
    """How the table's keys make one method for a problem, and which keys it takes."""

    make: Callable[[DesignSection, Any], Method]
    keys: tuple[str, ...]


def _local_kalman(design: DesignSection, _: Any) -> LocalKalman:
    return LocalKalman(gain=gain_rule(design), process=design.process, measurement=design.measurement)


def _scheme(design: DesignSection, kinds: Any) -> Any:
    """The ``scheme`` of the file, one of these ``kinds``; the first one unless given."""
    known = get_args(kinds)
    if design.scheme is None:
        return known[0]
    if design.scheme not in known:
        text = f"scheme of this method is one of {', '.join(known)}; got {design.scheme!r}"
        raise PlacedError(("design", "scheme"), text)
    return design.scheme


def _sampled(design: DesignSection, problem: Any) -> Method:
    form = _scheme(design, Form)
    return Sampled(_needed(design, "period"), form, _local_kalman(design, problem))


def _accelerated(design: DesignSection, _: Any) -> Method:
    scheme = _scheme(design, Scheme)
    return Accelerated(scheme, period=1.0 if design.period is None else design.period)


def _spectrum(design: DesignSection, problem: Any) -> Method:
    """Without a list: real eigenvalues from ``-2 rate`` to ``-rate``."""
    if design.eigenvalues is not None:
        return SpectrumAssignment(design.eigenvalues)
    rate = 1.0 if design.rate is None else design.rate
    count = problem.n_agents * problem.n_states if isinstance(problem, SharedPlant) else 1
    return SpectrumAssignment(np.linspace(-2.0 * rate, -rate, count).tolist())


def _centralised(design: DesignSection, _: Any) -> Method:
    return Centralised(_scheme(design, Kind), design.eigenvalues, design.rate)


ROWS: dict[str, Row] = {
    "local-kalman": Row(_local_kalman, (*_GAIN, *_COVARIANCES)),
    "integrator": Row(lambda d, _: IntegratorObserver(d.arc_weights, d.anchor_gain), ("arc_weights", "anchor_gain")),
    "sampled": Row(_sampled, (*_GAIN, *_COVARIANCES, "period", "scheme")),
    "discrete-kalman": Row(lambda d, _: DiscreteKalman(d.period or 1.0, d.process), ("period", "process")),
    "accelerated": Row(_accelerated, ("scheme", "period")),
    "heterogeneous": Row(lambda d, _: Heterogeneous(d.rate or 0.0), ("rate",)),
    "spectrum-assignment": Row(_spectrum, ("eigenvalues", "rate")),
    "coupling-gain": Row(lambda d, _: CouplingGain(_needed(d, "rate")), ("rate",)),
    "projected-consensus": Row(
        lambda d, _: ProjectedConsensus(_needed(d, "rate"), _needed(d, "period"), d.rounds),
        ("rate", "period", "rounds"),
    ),
    "scc-cascade": Row(lambda d, _: SccCascade(_needed(d, "rate")), ("rate",)),
    "brasch-pearson": Row(lambda d, _: BraschPearson(_listed(d)), ("eigenvalues",)),
    "centralised": Row(_centralised, ("scheme", "eigenvalues", "rate")),
}
"""Every method but ``weighted``, which is ``local-kalman`` with ``weights = "precision"`` here."""


def method_of(design: DesignSection, problem: Any) -> Method:
    """The design method that a scenario or the command line asks for; by default the one that fits the ``problem``."""
    label = label_of(design, problem)
    if label not in ROWS:
        known = ", ".join(ROWS)
        text = f"no design method is called {label!r}; known are {known}{nearest(label, ROWS)}"
        raise PlacedError(("design", "method"), text)
    row = ROWS[label]
    for key, field in sorted(type(design).model_fields.items()):
        value = getattr(design, key)
        chosen = value is not None and (not isinstance(value, str | float) or value != field.default)
        if chosen and key not in row.keys and key not in _EVERYWHERE:
            text = f"{key!r} does not belong to the method {label!r}; it takes {', '.join(row.keys)}"
            raise PlacedError(("design", key), text)
    return row.make(design, problem)


def label_of(design: DesignSection, problem: Any) -> str:
    """The method's name: the given one, or the one that fits the ``problem``."""
    if design.method is not None:
        return design.method
    if isinstance(problem, SharedPlant):
        return "spectrum-assignment"
    equal = isinstance(problem, NetworkedAgents) and problem.is_homogeneous
    return "local-kalman" if equal else "heterogeneous"


def gain_rule(design: DesignSection) -> GainRule:
    """The rule for the coupling gain."""
    margin = 1.05 if design.margin is None else design.margin
    if design.gain == "from-graph":
        return FromGraph(margin)
    if design.gain == "worst-case":
        if design.max_nodes is None:
            text = "gain 'worst-case' needs max_nodes (--max-nodes): the largest network it must serve"
            raise PlacedError(("design", "gain"), text)
        return WorstCase(design.max_nodes, margin)
    return Fixed(float(design.gain))


def _needed(design: DesignSection, key: str) -> float:
    value = getattr(design, key)
    if value is None:
        text = f"the method {design.method!r} needs {key!r} in [design]{_option(key)}"
        raise PlacedError(("design", "method"), text)
    return float(value)


def _listed(design: DesignSection) -> Sequence[complex]:
    if design.eigenvalues is None:
        raise PlacedError(("design", "method"), f"the method {design.method!r} needs 'eigenvalues' in [design]")
    values: Sequence[complex] = design.eigenvalues
    return values


def _option(key: str) -> str:
    return " (or --rate)" if key == "rate" else ""
