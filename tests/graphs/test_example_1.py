"""G16, Example 1 and Remark 1: the bundled four-node network and its published spectra."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest

from trigpoint.graphs import EXTERNAL, MeasurementGraph


@pytest.fixture(scope="module")
def example_1() -> MeasurementGraph:
    """Internal arcs 1-2, 1-3, 2-3, 2-4, 3-4, external arcs on 1 and 4 (the paper counts from 1)."""
    return MeasurementGraph(4, [EXTERNAL, 0, 0, 1, 1, 2, EXTERNAL], [0, 1, 2, 2, 3, 3, 3])


def integer_determinant(rows: list[list[int]]) -> int:
    """Exact, by expansion along the first row."""
    if not rows:
        return 1
    head, *rest = rows
    return sum(
        (-1) ** j * entry * integer_determinant([row[:j] + row[j + 1 :] for row in rest])
        for j, entry in enumerate(head)
        if entry
    )


def test_spectrum_of_the_generalized_laplacian(example_1) -> None:
    root = np.sqrt(17.0)
    spectrum = np.linalg.eigvalsh(example_1.laplacian().toarray())
    np.testing.assert_allclose(spectrum, [(5 - root) / 2, 3, 4, (5 + root) / 2], rtol=1e-14)
    np.testing.assert_allclose(spectrum, [0.43844719, 3, 4, 4.56155281], atol=5e-9)


def test_spectrum_with_the_environment_as_a_node(example_1) -> None:
    G0 = example_1.extended_incidence().toarray()
    np.testing.assert_allclose(np.linalg.eigvalsh(G0 @ G0.T), [0, 2, 3, 4, 5], atol=1e-14)


@pytest.mark.parametrize("size", [1, 2, 3, 4])
def test_the_incidence_is_totally_unimodular(example_1, size) -> None:
    G = example_1.incidence().toarray().astype(int).tolist()
    minors = {
        integer_determinant([[G[i][k] for k in columns] for i in rows])
        for rows in combinations(range(4), size)
        for columns in combinations(range(7), size)
    }
    assert minors <= {-1, 0, 1}
    assert minors != {0}


def test_the_oracle_of_minors_agrees_with_numpy() -> None:
    matrix = np.random.default_rng(0).integers(-3, 4, size=(4, 4))
    assert integer_determinant(matrix.tolist()) == round(np.linalg.det(matrix))
