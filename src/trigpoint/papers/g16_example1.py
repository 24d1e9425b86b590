"""G16, Example 1: the spectrum of the generalized Laplacian, without and with the environment as a node."""

from __future__ import annotations

import itertools

import numpy as np

import trigpoint as tp
from trigpoint.papers.base import Reproduction, cell

PRINTED = (0.4384, 3.0, 4.0, 4.5616)
PRINTED_WITH_ENVIRONMENT = (0.0, 2.0, 3.0, 4.0, 5.0)


def graph(weight: float = 1.0) -> tp.MeasurementGraph:
    """The four nodes of Example 1: five internal arcs, external arcs on the first (with ``weight``) and the last."""
    external = tp.EXTERNAL
    weights = None if weight == 1.0 else [1.0, 1.0, 1.0, 1.0, 1.0, weight, 1.0]
    return tp.MeasurementGraph(
        4, [0, 0, 1, 1, 2, external, external], [1, 2, 2, 3, 3, 0, 3], weights, names=["1", "2", "3", "4"]
    )


def run(weight: float = 1.0) -> Reproduction:
    """Compute both spectra; ``weight`` of the first external arc (the paper's is 1)."""
    g = graph(weight)
    extended = g.extended_incidence().toarray()
    ours = np.linalg.eigvalsh(g.laplacian().toarray())
    whole = np.linalg.eigvalsh((extended * g.arc_weights) @ extended.T)
    cells = [
        cell(f"eigenvalue {k + 1} of G G'", p, v, 5e-5) for k, (p, v) in enumerate(zip(PRINTED, ours, strict=True))
    ]
    cells += [
        cell(f"eigenvalue {k + 1} of G0 G0'", p, v, 1e-12)
        for k, (p, v) in enumerate(zip(PRINTED_WITH_ENVIRONMENT, whole, strict=True))
    ]
    cells.append(cell("minors of G outside -1, 0, 1 (Lemma 1)", 0.0, _strange_minors(g.incidence().toarray()), 0.0))
    text = "The generalized Laplacian of Example 1 is positive definite; with the environment as a node it is singular."
    return Reproduction("g16-example1", "G16, Example 1, Remark 1, Lemma 1", text, tuple(cells))


def _strange_minors(G: np.ndarray) -> int:
    """How many minors of G are none of -1, 0, 1: none in a totally unimodular matrix."""
    count = 0
    for size in range(1, min(G.shape) + 1):
        for rows in itertools.combinations(range(G.shape[0]), size):
            for columns in itertools.combinations(range(G.shape[1]), size):
                count += abs(round(float(np.linalg.det(G[np.ix_(rows, columns)])))) > 1
    return count
