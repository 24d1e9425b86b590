"""How far a stable system may first move away: the peak of ``||e^{H t}||``."""

from __future__ import annotations

import numpy as np

from trigpoint.arrays import FloatArray
from trigpoint.linalg.exponentials import exponentials


def transient_peak(H: FloatArray, steps: int = 64) -> float:
    """Largest 2-norm of ``e^{H t}`` over a grid of times, of one matrix or the largest over a stack.

    A lower bound of the true peak, close to it where the motion is resolved by the grid; inf where H is not Hurwitz.
    Args: ``H`` (n, n) or (k, n, n), and how many ``steps`` up to ten time constants of the slowest mode. Cost O(n^3) a
    step.
    """
    stack = H if H.ndim == 3 else H[None]
    abscissa = float(np.linalg.eigvals(stack).real.max())
    if not abscissa < 0.0:
        return float("inf")
    step = exponentials(stack * (10.0 / -abscissa / steps))
    power, peak = np.broadcast_to(np.eye(stack.shape[1]), stack.shape), 1.0
    for _ in range(steps):
        power = step @ power
        peak = max(peak, float(np.linalg.norm(power, 2, axis=(1, 2)).max()))
    return peak
