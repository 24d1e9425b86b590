"""The gain a network needs, and the worst case over all networks of a size (G16, Section 2.1 and Theorem 4)."""

from __future__ import annotations

import math
from numbers import Integral

from trigpoint.analysis.eigenvalue import EigenvalueBound, smallest_eigenvalue
from trigpoint.errors import ArgumentError
from trigpoint.graphs import MeasurementGraph


def gain_bound(graph: MeasurementGraph | EigenvalueBound) -> float:
    """``1 / lambda_min``: every coupling gain above it makes a network-decentralized observer stable.

    The rigorous lower bound of ``lambda_min`` is used, so that the result is never too small; infinity when some
    node of ``graph`` has no path to the environment. In place of the graph an ``EigenvalueBound`` may be reused.

    Source: G16, Theorem 4.
    """
    bound = graph if isinstance(graph, EigenvalueBound) else smallest_eigenvalue(graph)
    return math.inf if bound.lower <= 0.0 else 1.0 / bound.lower


def worst_case_gain(n_nodes: int) -> float:
    """``sigma_max(Phi_N)``: a gain above it serves every externally connected graph with N <= ``n_nodes`` nodes.

    ``1 / (2 + 2 cos(2 pi N / (2 N + 1)))``, computed as ``1 / (4 sin^2(pi / (2 (2 N + 1))))``, which does not cancel.

    We assume:
        * arc weights of at least 1 (E-000-14).

    Source: G16, Proposition 4, Theorems 1 and 7, Corollaries 1 and 3 (E-000-15).

    >>> round(worst_case_gain(8), 8)
    29.36529789
    """
    if isinstance(n_nodes, bool) or not isinstance(n_nodes, Integral) or n_nodes < 1:
        raise ArgumentError(f"n_nodes must be a whole number of at least 1; got {n_nodes!r}")
    return 1.0 / (4.0 * math.sin(math.pi / (2.0 * (2.0 * n_nodes + 1.0))) ** 2)


def worst_case_eigenvalue(n_nodes: int, components: int = 1) -> float:
    """Smallest ``lambda_min`` over all externally connected graphs with N = ``n_nodes`` and C = ``components``.

    Attained by the chain anchored at its end, on the N - C + 1 nodes of the largest possible component.
    Source: G16, Theorem 1 and Corollary 1 (E-000-14).
    """
    if isinstance(components, bool) or not isinstance(components, Integral) or not 1 <= components <= n_nodes:
        raise ArgumentError(f"components must be a whole number from 1 to n_nodes = {n_nodes}; got {components!r}")
    return 1.0 / worst_case_gain(n_nodes - components + 1)
