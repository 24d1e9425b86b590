"""G16, Theorem 1: the worst gain over all networks of a size, and the chain that attains it."""

from __future__ import annotations

import trigpoint as tp
from trigpoint.papers.base import Reproduction, cell

PRINTED_8 = 29.37


def run() -> Reproduction:
    """The printed value for N = 8, and the end-anchored chain's own smallest eigenvalue for several sizes."""
    cells = [cell("sigma_max(Phi_8)", PRINTED_8, tp.worst_case_gain(8), 5e-3)]
    for n in (2, 4, 8, 16, 64):
        attained = 1.0 / tp.smallest_eigenvalue(tp.graphs.chain(n)).value
        worst = tp.worst_case_gain(n)
        cells.append(cell(f"1/lambda_min of the chain of {n}", worst, attained, 1e-9 * worst))
    text = "No externally connected network of N nodes needs a larger gain than the chain anchored at its end."
    return Reproduction("g16-worst-case", "G16, Theorem 1, Proposition 4 and Section 5.3", text, tuple(cells))
