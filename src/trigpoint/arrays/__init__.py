"""NumPy only: aliases, freezing, shape checks, a small matrix exponential, arrays and bounds as text."""

from trigpoint.arrays.core import (
    BoolArray,
    FloatArray,
    IntArray,
    as_floats,
    as_indices,
    as_matrix,
    frozen,
    require_finite,
)
from trigpoint.arrays.exponential import expm, propagate, transition_and_integral
from trigpoint.arrays.rounding import at_least, at_most, exactly
from trigpoint.arrays.text import decode_array, digest_of, encode_array

__all__ = [
    "BoolArray",
    "FloatArray",
    "IntArray",
    "as_floats",
    "as_indices",
    "as_matrix",
    "at_least",
    "at_most",
    "decode_array",
    "digest_of",
    "encode_array",
    "exactly",
    "expm",
    "frozen",
    "propagate",
    "require_finite",
    "transition_and_integral",
]
