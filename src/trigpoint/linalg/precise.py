"""Eigenvalues of the stored floats to far more digits than they have: the optional engine ``python-flint``."""

from __future__ import annotations

import numpy as np

from trigpoint.arrays import FloatArray

_BITS = 600


def precise_eigenvalues(matrix: FloatArray) -> np.ndarray | None:
    """Eigenvalues (n,) of exactly this ``matrix``, computed with 600 bits; None without the extra ``precision``.

    Badly conditioned spectra come out right: with 600 bits a condition of 1e100 leaves every digit of a float.
    Cost: seconds for n = 120.
    """
    try:
        from flint import acb_mat, ctx
    except ImportError:
        return None
    before = ctx.prec
    try:
        ctx.prec = _BITS
        values = acb_mat(np.asarray(matrix).tolist()).eig(algorithm="approx")
        return np.array([complex(float(v.real.mid()), float(v.imag.mid())) for v in values])
    finally:
        ctx.prec = before
