"""Which additions to take: one greedy step after the other, or every set tried (the oracle for small problems)."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from typing import Literal

import numpy as np

from trigpoint.analysis.eigenvalue import EigenvalueBound, smallest_eigenvalue
from trigpoint.analysis.placement import (
    Choices,
    VarianceGains,
    attach,
    eigenvalues_after,
    first_best,
    floating_components,
    touching,
    with_arc,
)
from trigpoint.arrays import FloatArray, IntArray
from trigpoint.errors import ArgumentError
from trigpoint.graphs import MeasurementGraph
from trigpoint.linalg.rank_one import COMPLETE_LIMIT

Objective = Literal["lambda_min", "total_variance"]

_EXACT_WORK = 1e8
_BATCH_ENTRIES = 2_000_000
_CONFIRMED = 3
_SINGULAR = 1e-12


def greedily(
    graph: MeasurementGraph, choices: Choices, count: int, objective: Objective, budget: float
) -> Iterator[int]:
    """Yield up to ``count`` choices within ``budget``, each the best next one for ``graph`` with those before it."""
    gains = VarianceGains(np.full(choices.head.shape[0], np.inf))
    for _ in range(count):
        payable = choices.within(budget)
        if not payable.left.any():
            return
        chosen: int | None
        if objective == "lambda_min":
            chosen = _raise_eigenvalue(graph, payable)
        elif graph.is_externally_connected:
            chosen, gains = gains.best(graph, payable)
        else:
            chosen = attach(graph, payable)
        if chosen is None:
            return
        yield chosen
        graph, choices = with_arc(graph, choices, chosen), choices.without(chosen)
        budget -= float(choices.cost[chosen])


def _raise_eigenvalue(graph: MeasurementGraph, choices: Choices) -> int | None:
    """The choice that lifts the component with the smallest eigenvalue most, for its cost.

    Components without anchor come first, the largest first. Where no choice touches the component that decides,
    lambda_min cannot grow, and the total variance chooses.
    """
    before = smallest_eigenvalue(graph)
    label, found = _deciding(graph, choices, before)
    if not found.size:
        if not graph.is_externally_connected:
            return None
        return VarianceGains(np.full(choices.head.shape[0], np.inf)).best(graph, choices)[0]
    after = eigenvalues_after(graph, choices, found, label)
    score = (after - before.value) / choices.cost[found]
    if graph.n_nodes <= COMPLETE_LIMIT:
        return first_best(score, found)
    best = found[np.argsort(-score, kind="stable")[:_CONFIRMED]]  # estimates: the first few are computed
    sure = np.array([smallest_eigenvalue(with_arc(graph, choices, int(k))).value for k in best])
    return first_best((sure - before.value) / choices.cost[best], best)


def _deciding(graph: MeasurementGraph, choices: Choices, before: EigenvalueBound) -> tuple[int, IntArray]:
    if before.unanchored.size:
        return touching(graph, choices, floating_components(graph))
    label = int(graph.component_labels[before.nodes[0]])
    here, there = choices.ends(graph.component_labels, -1)
    return label, np.flatnonzero(choices.left & ((here == label) | (there == label)))


def best_set(
    graph: MeasurementGraph, choices: Choices, count: int, objective: Objective, budget: float
) -> tuple[int, ...]:
    """The best set of at most ``count`` choices within ``budget``, by trying all of them with dense eigenvalues.

    Without a budget only full sets are tried: a further arc never makes either objective worse.

    Raises:
        ArgumentError: more than 1e8 matrix entries in all sets together.

    Cost O(sets N^3).
    """
    total = choices.head.shape[0]
    largest = min(count, total)
    sizes = range(largest, 0, -1) if math.isfinite(budget) else range(largest, largest - 1, -1)
    work = sum(math.comb(total, size) for size in sizes) * graph.n_nodes**2
    if work > _EXACT_WORK:
        raise ArgumentError(
            f"exact search would try {work // graph.n_nodes**2} sets on {graph.n_nodes} nodes; at most "
            f"{int(_EXACT_WORK // graph.n_nodes**2)} are allowed. Give fewer candidates, or leave exact=False"
        )
    best: tuple[float, tuple[int, ...]] = (-math.inf, ())
    for size in sizes:
        for sets in _batches(total, size, max(1, _BATCH_ENTRIES // graph.n_nodes**2)):
            sets = sets[choices.cost[sets].sum(axis=1) <= budget * (1.0 + 1e-12)]
            if not sets.size:
                continue
            score = _scores(graph, choices, sets, objective)
            leader = int(np.flatnonzero(score >= score.max() - 1e-9 * abs(score.max()))[0])
            if not best[1] or score[leader] > best[0] + 1e-9 * abs(best[0]):
                best = (float(score[leader]), tuple(sets[leader].tolist()))
    return best[1]


def _batches(total: int, size: int, length: int) -> Iterator[IntArray]:
    sets = itertools.combinations(range(total), size)
    while rows := list(itertools.islice(sets, length)):
        yield np.array(rows, dtype=np.int64)


def _scores(graph: MeasurementGraph, choices: Choices, sets: IntArray, objective: Objective) -> FloatArray:
    """``lambda_min``, or minus the total variance (-1e300 where singular), for every row of choices."""
    b = choices.incidence(graph.n_nodes, np.arange(choices.head.shape[0])).toarray()
    added = np.einsum("ik,sk,jk->sij", b, _membership(sets, choices), b, optimize=True)
    values = np.linalg.eigvalsh(graph.laplacian().toarray()[None] + added)
    if objective == "lambda_min":
        return np.asarray(values[:, 0])
    singular = values[:, 0] <= _SINGULAR * values[:, -1]
    return np.where(singular, -1e300, -(1.0 / np.where(singular[:, None], 1.0, values)).sum(axis=1))


def _membership(sets: IntArray, choices: Choices) -> FloatArray:
    weights = np.zeros((sets.shape[0], choices.head.shape[0]))
    np.put_along_axis(weights, sets, choices.weight[sets], axis=1)
    return weights
