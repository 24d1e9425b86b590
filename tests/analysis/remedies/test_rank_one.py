"""The secular equation against recomputed eigenvalues."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse as sp

from trigpoint.linalg import rank_one
from trigpoint.linalg.rank_one import Tail, smallest_after, spectrum


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_all_eigenpairs(seed, sign) -> None:
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(8, 12))
    matrix = root @ root.T + 0.5 * np.eye(8)
    b = rng.normal(size=(6, 8))
    weight = sign * 0.9 / np.einsum("ki,ij,kj->k", b, np.linalg.inv(matrix), b)
    whole = spectrum(sp.csr_array(matrix))
    found = smallest_after(whole, (b @ whole.vectors) ** 2, weight)
    expected = [np.linalg.eigvalsh(matrix + w * np.outer(row, row))[0] for w, row in zip(weight, b, strict=True)]
    assert found == pytest.approx(expected, rel=1e-9)


def test_one_row_and_directions_that_change_nothing() -> None:
    one = spectrum(sp.csr_array([[2.0]]))
    assert smallest_after(one, np.array([[1.0]]), np.array([3.0])) == pytest.approx([5.0])
    assert smallest_after(one, np.array([[1.0]]), np.array([-0.5])) == pytest.approx([1.5])
    two = spectrum(sp.csr_array(np.diag([1.0, 4.0])))
    assert smallest_after(two, np.array([[0.0, 1.0]]), np.array([1.0])) == pytest.approx([1.0])
    assert smallest_after(two, np.array([[0.0, 1.0]]), np.array([-2.0])) == pytest.approx([1.0])
    assert smallest_after(two, np.array([[1.0, 0.0]]), np.array([-1.5])) == pytest.approx([0.0], abs=1e-12)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_remainders_bound_from_both_sides(monkeypatch, sign) -> None:
    rng = np.random.default_rng(7)
    root = rng.normal(size=(40, 60))
    matrix = root @ root.T + 0.5 * np.eye(40)
    inverse = np.linalg.inv(matrix)
    b = rng.normal(size=(20, 40))
    z = b @ inverse
    weight = sign * 0.5 / np.einsum("ki,ki->k", b, z)
    expected = [np.linalg.eigvalsh(matrix + w * np.outer(row, row))[0] for w, row in zip(weight, b, strict=True)]
    monkeypatch.setattr(rank_one, "COMPLETE_LIMIT", 10)
    monkeypatch.setattr(rank_one, "_LOWEST", 5)
    lowest = spectrum(sp.csr_array(matrix))
    squares = (b @ lowest.vectors) ** 2
    rho, nu = lowest.outside(squares, np.einsum("ki,ki->k", b, z), np.einsum("ki,ki->k", z, z))
    high = smallest_after(lowest, squares, weight, Tail.least(lowest, rho, nu))
    low = smallest_after(lowest, squares, weight, Tail.greatest(lowest, rho, nu))
    assert (high >= np.array(expected) * (1 - 1e-7)).all()
    assert (low <= np.array(expected) * (1 + 1e-7)).all()
    assert high == pytest.approx(expected, rel=0.2)
