"""G16, Example 1: the spectrum of the generalized Laplacian, without and with the environment as a node."""

from __future__ import annotations

import numpy as np

import trigpoint as tp
from trigpoint.papers.base import Reproduction, cell

PRINTED = (0.4384, 3.0, 4.0, 4.5616)
PRINTED_WITH_ENVIRONMENT = (0.0, 2.0, 3.0, 4.0, 5.0)


def graph() -> tp.MeasurementGraph:
    """The four nodes of Example 1: five internal arcs, and external arcs on the first and the last node."""
    external = tp.EXTERNAL
    return tp.MeasurementGraph(
        4, [0, 0, 1, 1, 2, external, external], [1, 2, 2, 3, 3, 0, 3], names=["1", "2", "3", "4"]
    )


def run() -> Reproduction:
    """Compute both spectra."""
    g = graph()
    extended = g.extended_incidence()
    ours = np.linalg.eigvalsh(g.laplacian().toarray())
    whole = np.linalg.eigvalsh((extended @ extended.T).toarray())
    cells = [
        cell(f"eigenvalue {k + 1} of G G'", p, v, 5e-5) for k, (p, v) in enumerate(zip(PRINTED, ours, strict=True))
    ]
    cells += [
        cell(f"eigenvalue {k + 1} of G0 G0'", p, v, 1e-12)
        for k, (p, v) in enumerate(zip(PRINTED_WITH_ENVIRONMENT, whole, strict=True))
    ]
    text = "The generalized Laplacian of Example 1 is positive definite; with the environment as a node it is singular."
    return Reproduction("g16-example1", "G16, Example 1 and Remark 1", text, tuple(cells))
