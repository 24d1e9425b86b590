"""Where to put the next anchors or measurements, greedily with what is proved about it, or by trying everything."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from trigpoint.analysis.eigenvalue import smallest_eigenvalue
from trigpoint.analysis.gain import gain_bound
from trigpoint.analysis.placement import Choices, total_variance, variance_after, with_arc
from trigpoint.analysis.search import Objective, best_set, greedily
from trigpoint.arrays import FloatArray, IntArray, as_floats, as_indices, frozen
from trigpoint.errors import ArgumentError, ShapeError
from trigpoint.graphs import EXTERNAL, MeasurementGraph

_OBJECTIVES = ("lambda_min", "total_variance")


@dataclass(frozen=True, eq=False)
class Recommendation:
    """What to add, in order, and what it brings (arrays with one entry an addition).

    Attributes:
        objective: ``lambda_min`` (greatest) or ``total_variance`` (``tr(L^-1)``, least).
        tail, head: the additions; tail is ``EXTERNAL`` for an anchor, whose node is ``head``.
        values: the objective after each addition; infinite total variance while nodes have no path to an anchor.
        eigenvalues: smallest eigenvalue after each, every one computed anew with rigorous bounds.
        gain_bounds: ``1 / lambda_min`` after each, from the rigorous lower bound.
        ceilings: what ``lambda_min`` cannot exceed with as much anchor weight: (sum of anchor weights) / N.
        before: the objective of the network as it is.
        guarantee: how far from the best this can be, in a sentence.
        graph: the network with all additions, as its last arcs.
    """

    objective: Objective
    tail: IntArray
    head: IntArray
    values: FloatArray
    eigenvalues: FloatArray
    gain_bounds: FloatArray
    ceilings: FloatArray
    before: float
    guarantee: str
    graph: MeasurementGraph

    @property
    def nodes(self) -> tuple[int, ...]:
        """The recommended anchors' nodes, in order (heads of the external arcs among the additions)."""
        return tuple(self.head[self.tail == EXTERNAL].tolist())

    @property
    def arcs(self) -> tuple[tuple[int, int], ...]:
        """The additions as (tail, head), in order."""
        return tuple(zip(self.tail.tolist(), self.head.tolist(), strict=True))

    def summary(self) -> str:
        """The additions as text, a line each, and the guarantee."""
        first = self.graph.n_arcs - self.tail.shape[0]
        lines = [f"{self.objective} before: {self.before:.6g}"]
        lines += [
            f"{k + 1}. {self.graph.arc_label(first + k)}: {self.objective} {self.values[k]:.6g}, "
            f"gain bound {self.gain_bounds[k]:.6g}, ceiling of lambda_min {self.ceilings[k]:.6g}"
            for k in range(self.tail.shape[0])
        ]
        return "\n".join([*lines, self.guarantee])


def recommend_anchors(
    graph: MeasurementGraph,
    count: int,
    objective: Objective = "lambda_min",
    candidates: ArrayLike | None = None,
    costs: ArrayLike | None = None,
    budget: float | None = None,
    exact: bool = False,
) -> Recommendation:
    """Recommend ``count`` nodes to anchor, one after the other, each the best next one.

    Components without anchor get their first one before anything else, the largest component first. For
    ``total_variance`` (``J = tr(L^-1)``) that first anchor is the exact best one; from there on the decrease of J is
    at least ``1 - 1/e`` of the greatest possible decrease (J is supermodular in the anchors). For ``lambda_min`` greedy
    has no such guarantee: the choice comes from the secular equation of the rank-one change, and every accepted value
    is confirmed by ``smallest_eigenvalue``. In any case ``lambda_min <= (sum of anchor weights) / N``.

    Args:
        graph: a network with scalar weights or none; new anchors get weight 1 (``recommend_arcs`` takes others).
        count: how many anchors, at least 1; fewer come back when candidates or budget run out.
        objective: ``lambda_min`` or ``total_variance``.
        candidates: nodes to choose from; None for all nodes without an external arc.
        costs: one positive number a candidate; the choice is then by benefit per cost (for the first anchor of a
            component: the least variance times cost).
        budget: greatest sum of costs (of anchors, without costs); None for no limit.
        exact: try every set instead (small problems only).

    We assume:
        * an anchor may be put on an anchored node again only where it is listed among the candidates.

    Raises:
        ArgumentError: count, objective, candidates, costs or budget that make no sense, weight blocks, or a problem
            too large for ``exact``.

    Cost: ``total_variance``: a factorization an anchor, a solve a candidate once and few later (lazy evaluation);
    ``lambda_min``: the eigenpairs of one component an anchor, all up to 800 nodes.
    Source: PattersonBamieh2010; G16, Section 5 and Proposition 1.
    """
    nodes = (
        np.setdiff1d(np.arange(graph.n_nodes), graph.anchored_nodes)
        if candidates is None
        else as_indices("candidates", candidates, 0, graph.n_nodes)
    )
    choices = _choices(graph, np.full(nodes.shape[0], EXTERNAL), nodes, np.ones(nodes.shape[0]), costs)
    return _recommend(graph, count, objective, choices, budget, exact)


def recommend_arcs(
    graph: MeasurementGraph,
    count: int,
    candidates: Sequence[Sequence[float]],
    objective: Objective = "lambda_min",
    costs: ArrayLike | None = None,
    budget: float | None = None,
    exact: bool = False,
) -> Recommendation:
    """Recommend ``count`` further measurements among ``candidates``, one after the other, each the best next one.

    As ``recommend_anchors``, for arcs of any kind. Total variance is not supermodular in arcs between nodes (two of
    them may be worth more together than apart), so that greedy has no guarantee here unless all are external.

    Args:
        graph: a network with scalar weights or none.
        count: how many arcs, at least 1.
        candidates: (tail, head) or (tail, head, weight) each; tail ``EXTERNAL`` for an anchor.
        objective: ``lambda_min`` or ``total_variance``.
        costs: one positive number a candidate; the choice is then by benefit per cost.
        budget: greatest sum of costs; None for no limit.
        exact: try every set instead (small problems only).

    We assume:
        * each candidate is taken at most once; the same arc may be listed several times.

    Raises:
        ArgumentError, ShapeError: as ``recommend_anchors``; a candidate that is no arc of these nodes.

    Cost: as ``recommend_anchors``, with a solve a candidate in every step for ``total_variance``.
    Source: PattersonBamieh2010 for external arcs; G16, Proposition 1.
    """
    rows = [tuple(row) for row in candidates]
    if any(len(row) not in (2, 3) for row in rows):
        raise ShapeError("each of the candidates must be (tail, head) or (tail, head, weight)")
    tail = as_indices("candidates' tail", [row[0] for row in rows], EXTERNAL, graph.n_nodes)
    head = as_indices("candidates' head", [row[1] for row in rows], 0, graph.n_nodes)
    weight = as_floats("candidates' weight", [row[2] if len(row) == 3 else 1.0 for row in rows])
    bad = np.flatnonzero((tail == head) | (weight <= 0))
    if bad.size:
        raise ArgumentError(f"candidates[{bad[0]}] = {rows[bad[0]]} must join two nodes with a positive weight")
    return _recommend(graph, count, objective, _choices(graph, tail, head, weight, costs), budget, exact)


def _choices(
    graph: MeasurementGraph, tail: IntArray, head: IntArray, weight: FloatArray, costs: ArrayLike | None
) -> Choices:
    if graph.weight is not None and graph.weight.ndim == 3:
        raise ArgumentError(
            f"recommendations take scalar weights; got {graph.dimension} x {graph.dimension} blocks: "
            "use graph.with_weight(None), or one axis at a time"
        )
    if not head.size:
        raise ArgumentError("candidates must hold at least one choice; got none (are all nodes anchored already?)")
    cost = np.ones(head.shape[0]) if costs is None else as_floats("costs", costs)
    if cost.shape != head.shape:
        raise ShapeError(f"costs must hold one number a candidate ({head.shape[0]}); got shape {cost.shape}")
    if (cost <= 0).any():
        raise ArgumentError(f"costs must be positive; got {cost[cost <= 0][0]}")
    return Choices(tail, head, weight, cost, np.ones(head.shape[0], dtype=np.bool_))


def _recommend(
    graph: MeasurementGraph,
    count: int,
    objective: Objective,
    choices: Choices,
    budget: float | None,
    exact: bool,
) -> Recommendation:
    if objective not in _OBJECTIVES:
        raise ArgumentError(f"objective must be one of {', '.join(_OBJECTIVES)}; got {objective!r}")
    if isinstance(count, bool) or not isinstance(count, (int, np.integer)) or count < 1:
        raise ArgumentError(f"count must be a whole number of at least 1; got {count!r}")
    limit = math.inf if budget is None else float(budget)
    if not limit >= float(choices.cost.min()):
        raise ArgumentError(f"budget {budget!r} buys none of the candidates; the cheapest costs {choices.cost.min()}")
    if exact:
        plan: Iterator[int] = iter(best_set(graph, choices, int(count), objective, limit))
    else:
        plan = greedily(graph, choices, int(count), objective, limit)
    return _follow(graph, choices, objective, plan, exact)


def _follow(
    graph: MeasurementGraph, choices: Choices, objective: Objective, plan: Iterator[int], exact: bool
) -> Recommendation:
    """Take the choices as planned and write down what each brings."""
    now, taken = graph, []
    before = smallest_eigenvalue(graph).value if objective == "lambda_min" else total_variance(graph)
    values, eigenvalues, gains, ceilings = [before], [], [], []
    for chosen in plan:
        last, now = now, with_arc(now, choices, chosen)
        bound = smallest_eigenvalue(now)
        taken.append(chosen)
        is_value = objective == "lambda_min"
        values.append(bound.value if is_value else variance_after(last, choices, chosen, values[-1]))
        eigenvalues.append(bound.value)
        gains.append(gain_bound(bound))
        ceilings.append(float(now.arc_weights[now.is_external].sum()) / now.n_nodes)
    return Recommendation(
        objective,
        frozen(choices.tail[taken], np.int64),
        frozen(choices.head[taken], np.int64),
        frozen(values[1:]),
        frozen(eigenvalues),
        frozen(gains),
        frozen(ceilings),
        before,
        _guarantee(graph, now, choices, objective, exact),
        now,
    )


def _guarantee(
    graph: MeasurementGraph, after: MeasurementGraph, choices: Choices, objective: Objective, exact: bool
) -> str:
    if not after.is_externally_connected:
        left = int((~after.component_is_anchored).sum())
        return f"{left} components still have no anchor: lambda_min is 0 and the total variance infinite; add more."
    if exact:
        return "The best of all sets of candidates within count and budget (exhaustive search)."
    if objective == "lambda_min":
        return (
            "Greedy on lambda_min has no guaranteed distance from the best set; every value is confirmed with "
            "rigorous bounds, and no set with this anchor weight exceeds the ceiling (sum of anchor weights) / N."
        )
    if (choices.tail != EXTERNAL).any():
        return "Greedy on the total variance has no guarantee for arcs between nodes (it is not supermodular in them)."
    if np.ptp(choices.cost) > 0:
        return "Greedy by benefit per cost: each step is the best for its price; no factor is guaranteed for the whole."
    first = "" if graph.is_externally_connected else "The first anchor of each component is its exact best one. "
    return (
        f"{first}From then on, the decrease of the total variance is at least 1 - 1/e = 63 % of the greatest possible "
        "with as many further anchors."
    )
