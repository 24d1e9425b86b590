"""The verb ``design`` and the list of methods."""

from __future__ import annotations

from typing import Any

from trigpoint.errors import ArgumentError
from trigpoint.methods.accelerated import Accelerated
from trigpoint.methods.base import Method
from trigpoint.methods.brasch_pearson import BraschPearson
from trigpoint.methods.centralised import Centralised
from trigpoint.methods.coupling_gain import CouplingGain
from trigpoint.methods.heterogeneous import Heterogeneous
from trigpoint.methods.integrator import IntegratorObserver
from trigpoint.methods.local_kalman import LocalKalman
from trigpoint.methods.projected_consensus import ProjectedConsensus
from trigpoint.methods.sampled import DiscreteKalman, Sampled
from trigpoint.methods.scc_cascade import SccCascade
from trigpoint.methods.spectrum_assignment import SpectrumAssignment
from trigpoint.methods.weighted import Weighted
from trigpoint.observers.network import NetworkObserver

METHODS: tuple[type[Method], ...] = (
    LocalKalman,
    Weighted,
    IntegratorObserver,
    Sampled,
    DiscreteKalman,
    Accelerated,
    Heterogeneous,
    SpectrumAssignment,
    CouplingGain,
    ProjectedConsensus,
    SccCascade,
    BraschPearson,
    Centralised,
)


def design(problem: Any, method: Any) -> NetworkObserver:
    """Design the observer of ``problem`` with ``method``.

    Args:
        problem: what is estimated, for example ``NetworkedAgents``.
        method: one of ``METHODS``, with its choices.

    Raises:
        MethodError: the method does not accept the problem; the message names the requirement, got and the remedy.
        ArgumentError: ``method`` is no method.
    """
    if not isinstance(method, Method):
        known = ", ".join(kind.__name__ for kind in METHODS)
        got = f"the class {method.__name__} itself" if isinstance(method, type) else repr(method)
        named = next((kind for kind in METHODS if method in (kind, kind.label)), None)
        hint = f"; write {named.__name__}()" if named is not None else ""
        raise ArgumentError(f"method must be one of {known}; got {got}{hint}")
    return method.build(problem)
