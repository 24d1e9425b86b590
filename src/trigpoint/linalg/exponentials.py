"""Exponentials of many small matrices at once."""

from __future__ import annotations

import numpy as np
import scipy.linalg as la

from trigpoint.arrays import FloatArray, expm

_SMALL = 64


def exponentials(stack: FloatArray) -> FloatArray:
    """``e^M`` of every matrix of ``stack`` (..., n, n).

    Up to 64 rows all matrices of a like size are taken at once (``arrays.expm``); above, SciPy takes one by one.
    """
    return expm(stack) if stack.shape[-1] <= _SMALL else np.asarray(la.expm(stack), dtype=np.float64)
