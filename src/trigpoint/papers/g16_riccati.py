"""G16, Section 5.3: the local Kalman solution Q_1 of the planar double integrator, and the erratum in its noise."""

from __future__ import annotations

import numpy as np

import trigpoint as tp
from trigpoint.papers.base import Reproduction, cell

PRINTED_DIAGONAL = 1.41


def agent() -> tp.LinearAgent:
    """The planar double integrator that tells its position."""
    zero, one = np.zeros((2, 2)), np.eye(2)
    return tp.LinearAgent(np.block([[zero, one], [zero, zero]]), np.hstack([one, zero]), np.vstack([zero, one]))


def local_filter(process: np.ndarray) -> np.ndarray:
    """Q_1 for the planar double integrator and a process covariance, through the public design."""
    problem = tp.NetworkedAgents(tp.graphs.chain(1), agent())
    observer = tp.design(problem, tp.methods.LocalKalman(process=process))
    return np.asarray(observer.facts["Q"])


def run(acceleration: float = 1.0) -> Reproduction:
    """The printed matrix belongs to M = diag(0, 0, 1, 1); the stated M = I gives another diagonal (E-000-4).

    Args: ``acceleration``, the last two entries of M.
    """
    meant = local_filter(np.diag([0.0, 0.0, acceleration, acceleration]))
    stated = local_filter(np.eye(4))
    cells = (
        cell("diagonal of Q_1, M = diag(0, 0, 1, 1)", PRINTED_DIAGONAL, meant[0, 0], 5e-3),
        cell("off the diagonal, M = diag(0, 0, 1, 1)", 1.0, meant[0, 2], 5e-3),
        cell("diagonal of Q_1, M = I (as stated)", PRINTED_DIAGONAL, stated[0, 0], 5e-3, erratum=True, note="E-000-4"),
    )
    text = "The printed Q_1 belongs to noise on the accelerations only; with M = I its diagonal is sqrt(3)."
    return Reproduction("g16-riccati", "G16, Section 5.3", text, cells)
