"""Plants from and to python-control's ``StateSpace``; needs the extra ``control``."""

from __future__ import annotations

import importlib
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import networkx as nx
import numpy as np

from trigpoint.arrays import as_matrix
from trigpoint.errors import ArgumentError, MissingExtraError
from trigpoint.model.shared_plant import SharedPlant


def control_package(purpose: str) -> Any:
    """The package ``control``, or ``MissingExtraError`` that says what ``purpose`` needs it for."""
    try:
        return importlib.import_module("control")
    except ImportError as error:
        raise MissingExtraError("control", "control", purpose) from error


def require_continuous(system: Any) -> None:
    """Refuse what is no ``control.StateSpace`` in continuous time; the argument is called ``system`` in the error."""
    package = control_package("a python-control system")
    if not isinstance(system, package.StateSpace):
        raise ArgumentError(f"system must be a control.StateSpace (control.ss converts); got {type(system).__name__}")
    if system.dt not in (None, 0) or system.dt is False:
        raise ArgumentError(f"system must be in continuous time (dt = 0); got dt = {system.dt!r}")


def plant_from_control(
    system: Any,
    rows: Sequence[Sequence[int]] | None = None,
    neighbours: Mapping[int, Iterable[int]] | nx.DiGraph | None = None,
) -> SharedPlant:
    """A ``SharedPlant`` from a ``control.StateSpace`` in continuous time without direct term.

    Args:
        system: ``x' = A x + B u``, ``y = C x``.
        rows: which outputs each agent reads, one list an agent; None: one agent reads all of them.
        neighbours: whom each agent hears, as ``SharedPlant`` takes it; None: nobody hears anybody.

    Raises:
        ArgumentError: no StateSpace, discrete time, D not zero, an output that does not exist.
        MissingExtraError: python-control is not installed.

    Source: W17, equation (1).
    """
    require_continuous(system)
    A, B, C, D = (as_matrix(name, getattr(system, name)) for name in ("A", "B", "C", "D"))
    if D.any():
        raise ArgumentError(f"system must have D = 0: subtract D u from the readings instead; got D of shape {D.shape}")
    chosen = [list(range(C.shape[0]))] if rows is None else [list(each) for each in rows]
    for agent, each in enumerate(chosen):
        if any(type(row) is not int or not 0 <= row < C.shape[0] for row in each):
            raise ArgumentError(f"rows[{agent}] must list outputs 0 to {C.shape[0] - 1} of the system; got {each}")
    return SharedPlant(
        A, [C[each] for each in chosen], {} if neighbours is None else neighbours, B if B.any() else None
    )


def plant_to_control(problem: SharedPlant) -> Any:
    """``control.StateSpace`` of a shared plant: its known inputs to all agents' outputs, agent after agent.

    Args:
        problem: the plant; who hears whom has no place in a StateSpace and is left behind. A plant without input gets
            one that moves nothing, since a StateSpace cannot be without.

    Raises ``MissingExtraError`` where python-control is not installed. Source: W17, equation (1).
    """
    package = control_package("plant_to_control")
    C = problem.stacked_output()
    B = np.zeros((problem.n_states, 1)) if problem.B is None else problem.B
    return package.StateSpace(problem.A, B, C, np.zeros((C.shape[0], B.shape[1])))
