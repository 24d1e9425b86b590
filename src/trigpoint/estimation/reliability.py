"""Do the residuals fit the stated sigmas, and which measurements do not: the global test and data snooping."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import special

from trigpoint.arrays import FloatArray
from trigpoint.errors import ArgumentError

SUSPECT_PROBABILITY = 0.001
"""A measurement is suspect when errors of the assumed kind give so large a residual with less than this chance."""

GLOBAL_LEVEL = 0.001
"""The stated sigmas are doubted when errors that follow them give so improbable an m0 with less than this chance."""

_NO_SMALLER = 1e-300


@dataclass(frozen=True)
class GlobalTest:
    """The global test of an adjustment: ``v' R^-1 v`` against chi-square on the degrees of freedom.

    Two-sided: ``p_value = min(1, 2 min(P(chi2 <= statistic), P(chi2 >= statistic)))``, so that sigmas that are far too
    large fail it, too.

    Attributes:
        statistic: weighted sum of the squared residuals, by the stated covariance.
        degrees_of_freedom: measured numbers minus unknown numbers, at least 1.
        p_value: chance of a statistic at least so improbable (0 where it is below the smallest number).
        level: chance of failing although the sigmas are right.

    We assume:
        * errors are normal with mean zero and the stated covariance.

    Source: Baarda (1968), key Baarda1968.
    """

    statistic: float
    degrees_of_freedom: int
    p_value: float
    level: float

    @staticmethod
    def of(statistic: float, degrees_of_freedom: int, level: float) -> GlobalTest:
        """Test ``statistic`` on ``degrees_of_freedom`` at ``level``."""
        below, above = (float(side(degrees_of_freedom, statistic)) for side in (special.chdtr, special.chdtrc))
        return GlobalTest(statistic, degrees_of_freedom, min(1.0, 2.0 * min(below, above)), level)

    @property
    def passes(self) -> bool:
        """Whether the stated sigmas explain the residuals."""
        return self.p_value >= self.level

    @property
    def too_large(self) -> bool:
        """Whether it fails because the residuals are larger than the stated sigmas explain."""
        return not self.passes and self.statistic > self.degrees_of_freedom

    @property
    def text(self) -> str:
        """One line: m0, whether it fits, and what that may mean."""
        m0 = np.sqrt(self.statistic / self.degrees_of_freedom)
        p = f"p {self.p_value:.2g}" if self.p_value > _NO_SMALLER else f"p below {_NO_SMALLER:g}"
        count = f"{self.degrees_of_freedom} degree{'' if self.degrees_of_freedom == 1 else 's'} of freedom"
        if self.passes:
            return f"m0 {m0:.3g} fits the stated sigmas ({count}, {p})"
        cause = "a blunder, or sigmas too small" if self.too_large else "sigmas too large"
        return f"m0 {m0:.3g} does not fit the stated sigmas ({count}, {p}): {cause}"


def checked_level(level: float) -> float:
    """``level`` if it is a probability strictly between 0 and 1."""
    if not 0.0 < level < 1.0:
        raise ArgumentError(f"level must be a probability between 0 and 1, such as 0.001; got {level}")
    return float(level)


def suspects_of(standardized: FloatArray, freedom: int | None) -> tuple[int, ...]:
    """Arcs beyond the level, the worst first, by their standardized residuals (M, d).

    ``freedom`` is None where the stated sigmas scaled the residuals (normal distribution); otherwise an m0 that they
    themselves took part in did.
    """
    worst = np.abs(standardized).max(axis=1, initial=0.0)
    if freedom is None:
        level = -float(special.ndtri(SUSPECT_PROBABILITY / 2.0))
    elif freedom < 2:
        return ()
    else:
        # |t| = w sqrt((f - 1) / (f - w^2)) is Student's with f - 1 degrees of freedom; solved for w.
        t = -float(special.stdtrit(freedom - 1, SUSPECT_PROBABILITY / 2.0))
        level = t * float(np.sqrt(freedom / (freedom - 1 + t * t)))
    found = np.flatnonzero(worst > level)
    return tuple(int(k) for k in found[np.argsort(-worst[found], kind="stable")])
