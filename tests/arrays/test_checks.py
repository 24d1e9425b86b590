"""Array checks: what enters is finite, real, of the right shape, and never shared with the caller."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest

from trigpoint.arrays import as_floats, as_indices, as_matrix, frozen, require_finite
from trigpoint.errors import (
    ArgumentError,
    FileFormatError,
    MethodError,
    MissingExtraError,
    ProtocolError,
    ShapeError,
    TrigpointError,
)


def test_frozen_copies_and_forbids_writing() -> None:
    source = np.arange(3.0)
    copy = frozen(source)
    source[0] = 7.0
    assert copy[0] == 0.0
    with pytest.raises(ValueError, match="read-only"):
        copy[0] = 1.0


@pytest.mark.parametrize("value", [[1, 2], (1.0, 2.0), np.array([True, False]), [Fraction(1, 2)], np.float32(3), []])
def test_as_floats_takes_numbers_of_any_kind(value) -> None:
    array = as_floats("x", value)
    assert array.dtype == np.float64
    assert not array.flags.writeable


@pytest.mark.parametrize(
    "value", [["1", "2"], "1", [[1], [1, 2]], np.array([1 + 2j]), [1j], np.array(["2020-01-01"], "datetime64[D]"), [{}]]
)
def test_as_floats_refuses_what_is_no_real_number(value) -> None:
    with pytest.raises(ArgumentError, match="x must be an array of real numbers"):
        as_floats("x", value)


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf, None])
def test_as_floats_names_the_first_bad_position(bad) -> None:
    with pytest.raises(ArgumentError, match=r"x must be finite; got .* at position 2"):
        as_floats("x", [0.0, 1.0, bad, bad])
    with pytest.raises(ArgumentError, match=r"position \(1, 0\)"):
        as_floats("x", [[0.0, 1.0], [bad, 1.0]])


def test_require_finite_accepts_the_empty_array() -> None:
    require_finite("x", np.zeros((0, 3)))


def test_as_matrix_makes_a_scalar_one_by_one() -> None:
    assert as_matrix("A", 2.0).shape == (1, 1)


@pytest.mark.parametrize(
    ("value", "rows", "columns", "words"),
    [
        ([1.0, 2.0], None, None, r"A must be a matrix of shape \(any, any\); got an array of shape \(2,\)"),
        (np.zeros((2, 2, 2)), None, None, r"got an array of shape \(2, 2, 2\)"),
        (np.zeros((2, 3)), 3, None, r"A must have shape \(3, any\); got \(2, 3\)"),
        (np.zeros((2, 3)), None, 2, r"A must have shape \(any, 2\); got \(2, 3\)"),
    ],
)
def test_as_matrix_names_both_shapes(value, rows, columns, words) -> None:
    with pytest.raises(ShapeError, match=words):
        as_matrix("A", value, rows, columns)


@pytest.mark.parametrize(
    ("value", "words"),
    [
        ([0, 3], r"k\[1\] = 3 is no index; expected -1 <= index < 3"),
        ([-2], r"k\[0\] = -2"),
        (np.array([2**64 - 1], dtype=np.uint64), r"k\[0\] = 18446744073709551615"),
        ([0.0, 1.0], "one-dimensional array of node indices; got dtype float64"),
        ([True], "got dtype bool"),
        ([[0]], r"shape \(1, 1\)"),
        (np.zeros((0, 2), dtype=int), r"shape \(0, 2\)"),
        ([2**70], "got dtype object"),
        (0, r"shape \(\)"),
    ],
)
def test_as_indices_refuses_what_is_no_index(value, words) -> None:
    with pytest.raises(ArgumentError, match=words):
        as_indices("k", value, -1, 3)


def test_as_indices_takes_unsigned_and_empty() -> None:
    assert as_indices("k", np.array([2, 0], dtype=np.uint8), 0, 3).tolist() == [2, 0]
    assert as_indices("k", [], 0, 3).dtype == np.int64


def test_every_error_is_a_trigpoint_error_with_its_facts() -> None:
    read = FileFormatError("a.csv", "no header", 3)
    assert (str(read), read.path, read.line) == ("a.csv:3: no header", "a.csv", 3)
    assert str(FileFormatError("a.csv", "empty")) == "a.csv: empty"
    method = MethodError("LocalKalman", "equal agents", "two kinds", "Use Heterogeneous().")
    assert str(method) == "LocalKalman needs equal agents; got two kinds. Use Heterogeneous()."
    extra = MissingExtraError("xarray", "data", "Run.dataset")
    assert "pip install 'trigpoint[data]'" in str(extra)
    assert "in a checkout: python -m pip install -e '.[data]'" in str(extra)
    for error in (read, method, extra, ShapeError(), ProtocolError()):
        assert isinstance(error, TrigpointError)
    for kind in (FileFormatError, MethodError, ShapeError, ProtocolError):
        assert issubclass(kind, ValueError)
    assert issubclass(ShapeError, ArgumentError)
