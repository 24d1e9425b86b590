"""R23, Section IV: what the differences around a cycle tell, without and with an anchor."""

from __future__ import annotations

import numpy as np

import trigpoint as tp
from trigpoint.arrays import FloatArray
from trigpoint.papers.base import Cell, Reproduction, cell, expected, found, holds


def observability_rank(A: FloatArray, C: FloatArray) -> int:
    """Rank of ``[C; C A; ...; C A^(n-1)]``."""
    blocks = [C]
    for _ in range(A.shape[0] - 1):
        blocks.append(blocks[-1] @ A)
    return int(np.linalg.matrix_rank(np.vstack(blocks)))


def run(largest: int = 8, rate: float = 2.0) -> Reproduction:
    """Ranks and verdicts of Propositions 8 and 10 and of the examples with three nodes.

    Args:
        largest: cycles of 2 to so many nodes.
        rate: last entry of the example's A = diag(1, 1, 2).
    """
    cells = []
    for n in range(2, largest + 1):
        C = np.eye(n) - np.roll(np.eye(n), 1, axis=1)
        graph, anchored = _cycle(n, ()), _cycle(n, (n - 1,))
        cells.append(cell(f"rank of the cycle matrix, n = {n}", n - 1, np.linalg.matrix_rank(C), 0.0))
        same = np.allclose(C.T @ C, graph.laplacian().toarray())
        cells.append(found(f"C'C is the Laplacian of the cycle, n = {n}", same, "E-001-12: up to orientation"))
        rank = np.linalg.matrix_rank(anchored.incidence().toarray())
        cells.append(cell(f"rank of the anchored cycle matrix, n = {n}", n, rank, 0.0))
    cells += _examples(rate)
    cells += _complex_modes()
    text = (
        "Differences around a cycle leave one direction unseen, the common level; an anchor closes it. The rank test "
        "must run over complex numbers (E-001-1)."
    )
    return Reproduction("r23-cycles", "R23, Section IV, Propositions 8 and 10, Theorem 9", text, tuple(cells))


def _cycle(n: int, anchors: tuple[int, ...]) -> tp.MeasurementGraph:
    """The cycle of n nodes; for two nodes both arcs between them."""
    external = tp.EXTERNAL
    tail = [*range(n), *(external for _ in anchors)]
    return tp.MeasurementGraph(n, tail, [*((k + 1) % n for k in range(n)), *anchors])


def _examples(rate: float) -> list[Cell]:
    cells = []
    C = np.eye(3) - np.roll(np.eye(3), 1, axis=1)
    for name, A, printed in (
        ("diag(1, 1, 2)", np.diag([1.0, 1.0, rate]), 3),
        ("the identity", np.eye(3), 2),
        ("zero", np.zeros((3, 3)), 2),
    ):
        rank = observability_rank(A, C)
        verdict = tp.diagnose(tp.RelativeSensing(A, _cycle(3, ()))).observable
        cells.append(cell(f"observability rank, cycle of 3, A = {name}", printed, rank, 0.0))
        cells.append(holds(f"Theorem 9 says the same, A = {name}", verdict is (printed == 3)))
        anchored = tp.diagnose(tp.RelativeSensing(A, _cycle(3, (2,)))).observable
        cells.append(holds(f"observable with an anchor, A = {name}", anchored is True, "Proposition 10"))
    return cells


def _complex_modes() -> list[Cell]:
    """A rotation and a decoupled state: full rank at every real s, unobservable all the same."""
    A = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 2.0]])
    C = np.array([[0.0, 0.0, 1.0]])

    def rank(s: complex) -> int:
        return int(np.linalg.matrix_rank(np.vstack([s * np.eye(3) - A, C])))

    real = min(rank(complex(s)) for s in np.linspace(-4.0, 4.0, 161))
    note = "E-001-1: s is complex"
    return [
        expected("least rank of [s I - A; C] over real s", 3, real, 0.0, "a rotation, unmeasured"),
        cell("least rank over all s, as Theorem 6 tests it", real, rank(1j), 0.0, erratum=True, note=note),
        expected("observability rank of that pair", 1, observability_rank(A, C), 0.0, "unobservable"),
    ]
