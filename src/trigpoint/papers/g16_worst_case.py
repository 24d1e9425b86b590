"""G16, Theorem 1: the worst gain over all networks of a size, and the chain that attains it."""

from __future__ import annotations

import numpy as np

import trigpoint as tp
from trigpoint.papers.base import Reproduction, Series, cell, expected, unspecified

PRINTED_8 = 29.37


def run(nodes: int = 8, weight: float = 1.0) -> Reproduction:
    """The printed value for N = 8 (``nodes``), and the end-anchored chain's own smallest eigenvalue for several sizes.

    Args: ``weight`` of every arc of the chains (the paper's is 1).
    """
    cells = [cell("sigma_max(Phi_8)", PRINTED_8, tp.worst_case_gain(nodes), 5e-3)]
    sizes, worst, attained = (2, 4, 8, 16, 64), [], []
    for n in sizes:
        chain = tp.graphs.chain(n)
        chain = chain if weight == 1.0 else chain.with_weight(np.full(chain.n_arcs, weight))
        attained.append(1.0 / tp.smallest_eigenvalue(chain).value)
        worst.append(tp.worst_case_gain(n))
        cells.append(cell(f"1/lambda_min of the chain of {n}", worst[-1], attained[-1], 1e-9 * worst[-1]))
    simple, exact = 4.0 * nodes**2 / np.pi**2, tp.worst_case_gain(nodes)
    note = "E-000-11: right for large N only"
    cells.append(cell("sigma_max(Phi_8) by 4 N^2 / pi^2", simple, exact, 0.01 * exact, erratum=True, note=note))
    better = (2 * nodes + 1) ** 2 / np.pi**2 + 1.0 / 12.0
    cells.append(expected("sigma_max(Phi_8) by (2 N + 1)^2 / pi^2 + 1/12", better, exact, 1e-3, "its value"))
    cells.append(unspecified("sigma_max(Phi_100)", tp.worst_case_gain(100), "not printed"))
    lines = {"sigma_max(Phi_N)": np.array(worst), "1/lambda_min of the chain": np.array(attained)}
    series = (Series("Worst-case gain", "number of nodes", "gain", np.array(sizes, dtype=float), lines, log_y=True),)
    text = "No externally connected network of N nodes needs a larger gain than the chain anchored at its end."
    return Reproduction("g16-worst-case", "G16, Theorem 1, Proposition 4 and Section 5.3", text, tuple(cells), series)
