"""The one owner of index ranges: node-major blocks."""

from __future__ import annotations

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
from hypothesis import given, settings
from hypothesis import strategies as st

from trigpoint.linalg.blocks import Blocks, block_diagonal, expand, repeat_diagonal


@settings(max_examples=30)
@given(st.integers(1, 6), st.integers(1, 4))
def test_slices_and_positions_tile_the_stacked_vector(count, size) -> None:
    blocks = Blocks(count, size)
    stacked = np.arange(blocks.total)
    assert np.array_equal(np.concatenate([stacked[blocks.slice(k)] for k in range(count)]), stacked)
    order = np.arange(count)[::-1]
    expected = np.concatenate([stacked[blocks.slice(k)] for k in order])
    assert np.array_equal(blocks.positions(order), expected)


def test_split_and_stack_are_inverse_and_do_not_copy() -> None:
    blocks = Blocks(3, 2)
    stacked = np.arange(24.0).reshape(4, 6)
    table = blocks.split(stacked)
    assert table.shape == (4, 3, 2)
    assert np.array_equal(table[1, 2], stacked[1, blocks.slice(2)])
    assert np.shares_memory(table, stacked)
    assert np.array_equal(blocks.stack(table), stacked)
    assert np.shares_memory(blocks.stack(table), stacked)


def test_positions_of_no_block_are_empty() -> None:
    assert Blocks(3, 2).positions(np.zeros(0, dtype=np.int64)).shape == (0,)


def test_block_matrices_equal_their_dense_definitions() -> None:
    rng = np.random.default_rng(0)
    block, several, matrix = rng.normal(size=(2, 3)), rng.normal(size=(4, 2, 3)), rng.normal(size=(3, 5))
    assert np.array_equal(repeat_diagonal(4, block).toarray(), np.kron(np.eye(4), block))
    assert np.array_equal(block_diagonal(several).toarray(), la.block_diag(*several))
    assert np.array_equal(expand(sp.csr_array(matrix), 2).toarray(), np.kron(matrix, np.eye(2)))
    assert np.array_equal(expand(sp.csr_array(matrix), 1).toarray(), matrix)
