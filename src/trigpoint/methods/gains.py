"""How the coupling gain gamma is chosen (G16, Theorems 4, 6, 7)."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from trigpoint.analysis import EigenvalueBound, smallest_eigenvalue, worst_case_gain
from trigpoint.errors import ArgumentError, MethodError
from trigpoint.graphs import MeasurementGraph


@dataclass(frozen=True)
class GainChoice:
    """A chosen gain and what it rests on.

    Attributes:
        gain: the coupling gain gamma.
        lambda_floor: every network it is meant for has ``lambda_min`` at least this (rigorous; 0: nothing assured).
        text: the reason in words.
    """

    gain: float
    lambda_floor: float
    text: str


class GainRule(ABC):
    """A rule that chooses the coupling gain for a graph."""

    @abstractmethod
    def choose(self, graph: MeasurementGraph, bound: EigenvalueBound) -> GainChoice:
        """Choose the gain; ``bound`` is the smallest eigenvalue of ``graph``."""


@dataclass(frozen=True)
class FromGraph(GainRule):
    """``margin / lambda_min`` of the graph at hand, with the rigorous lower bound. Source: G16, Theorem 4."""

    margin: float = 1.05

    def __post_init__(self) -> None:
        """Check the margin."""
        _check_margin(self.margin)

    def choose(self, graph: MeasurementGraph, bound: EigenvalueBound) -> GainChoice:
        """Choose for this graph only."""
        if bound.lower <= 0.0:
            names = [graph.names[k] for k in bound.unanchored[:8].tolist()]
            more = f" and {bound.unanchored.size - 8} more" if bound.unanchored.size > 8 else ""
            raise MethodError(
                "FromGraph",
                "a path from every node to an external arc (lambda_min > 0)",
                f"no such path from {', '.join(names)}{more}" if names else f"lambda_min >= {bound.lower:g}",
                "Add an anchor there, or give the gain: Fixed(gamma), WorstCase(max_nodes).",
            )
        return GainChoice(self.margin / bound.lower, bound.lower, f"{self.margin:g} / lambda_min (Theorem 4)")


@dataclass(frozen=True)
class WorstCase(GainRule):
    """``margin * sigma_max(Phi_N)``: for every externally connected graph of at most ``max_nodes`` nodes.

    Weights below 1 are refused: the bound holds for weights of at least 1 (E-000-14).
    Source: G16, Theorem 7 and Corollaries 1 and 3.
    """

    max_nodes: int
    margin: float = 1.05

    def __post_init__(self) -> None:
        """Check the margin; ``max_nodes`` is checked by ``worst_case_gain``."""
        _check_margin(self.margin)
        worst_case_gain(self.max_nodes)

    def choose(self, graph: MeasurementGraph, bound: EigenvalueBound) -> GainChoice:  # noqa: ARG002 (the size decides)
        """Choose for all graphs of that size."""
        if graph.n_nodes > self.max_nodes:
            raise MethodError(
                "WorstCase",
                f"at most max_nodes = {self.max_nodes} nodes",
                f"{graph.n_nodes} nodes",
                "Raise max_nodes.",
            )
        weight = graph.arc_weights
        sizes = weight if weight.ndim == 1 else np.linalg.eigvalsh(weight)[:, 0]
        least = float(sizes.min(initial=np.inf))
        if least < 1.0:
            raise MethodError(
                "WorstCase",
                "arc weights of at least 1 (sigma_max(Phi_N) assumes it)",
                f"a weight of {least:.6g}",
                "Scale the weights up, or use FromGraph().",
            )
        worst = worst_case_gain(self.max_nodes)
        # The closed form is accurate to a few units in the last place; two parts in 1e15 keep the floor below it.
        floor = (1.0 - 2e-15) / worst
        return GainChoice(
            self.margin * worst, floor, f"{self.margin:g} sigma_max(Phi_{self.max_nodes}) (Theorem 7, Corollary 3)"
        )


@dataclass(frozen=True)
class Family(GainRule):
    """``margin * max over the graphs of 1 / lambda_min``, for switching among them.

    The maximum is meant where the paper prints a minimum (E-000-1). Source: G16, Theorem 6, equation (23).
    """

    graphs: tuple[MeasurementGraph, ...]
    margin: float = 1.05

    def __init__(self, graphs: Sequence[MeasurementGraph], margin: float = 1.05) -> None:
        _check_margin(margin)
        if not graphs:
            raise ArgumentError("graphs must hold at least one graph")
        object.__setattr__(self, "graphs", tuple(graphs))
        object.__setattr__(self, "margin", margin)

    def choose(self, graph: MeasurementGraph, bound: EigenvalueBound) -> GainChoice:
        """Choose for all graphs of the family, the problem's own included."""
        lowest = bound.lower
        for k, other in enumerate(self.graphs):
            floor = smallest_eigenvalue(other).lower
            if floor <= 0.0:
                raise MethodError(
                    "Family", "every graph externally connected", f"graph {k} is not", "Leave it out or anchor it."
                )
            lowest = min(lowest, floor)
        if lowest <= 0.0:
            return FromGraph(self.margin).choose(graph, bound)
        return GainChoice(
            self.margin / lowest, lowest, f"{self.margin:g} max 1/lambda_min over {len(self.graphs)} graphs (Theorem 6)"
        )


@dataclass(frozen=True)
class Fixed(GainRule):
    """A gain ``gamma`` given by the user; the design then reports what it guarantees, if anything."""

    gamma: float

    def __post_init__(self) -> None:
        """Check that the gain is a positive number."""
        if not (np.isfinite(self.gamma) and self.gamma > 0):
            raise ArgumentError(f"gamma must be a positive number; got {self.gamma}")

    def choose(self, graph: MeasurementGraph, bound: EigenvalueBound) -> GainChoice:  # noqa: ARG002 (same form for all)
        """Return the given gain."""
        return GainChoice(float(self.gamma), bound.lower, "given")


def _check_margin(margin: float) -> None:
    if not (np.isfinite(margin) and margin > 1.0):
        raise ArgumentError(f"margin must be above 1 (the theorems ask for gamma > bound); got {margin}")
