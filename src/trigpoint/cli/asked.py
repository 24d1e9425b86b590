"""The claims that ``certify`` is asked for by options."""

from __future__ import annotations

from trigpoint.certificates import (
    Claim,
    CovarianceBound,
    DelayMargin,
    MeanSquareStability,
    NoiseBudget,
    SampledStability,
    SwitchingStability,
)
from trigpoint.errors import ArgumentError


def claims_asked(
    *, period: float | None, delay: float | None, arrival: float | None, max_nodes: int | None, mu: float | None
) -> list[Claim]:
    """One claim for each option given: ``period``, ``delay``, ``arrival``, ``max_nodes``, ``mu``."""
    claims: list[Claim] = []
    if max_nodes is not None:
        claims.append(SwitchingStability(max_nodes=max_nodes))
    if period is not None and arrival is None:
        claims.append(SampledStability(period))
    if delay is not None:
        claims.append(DelayMargin(delay))
    if arrival is not None:
        if period is None:
            raise ArgumentError("--arrival needs --period: seconds between two exchanges")
        claims.append(MeanSquareStability(arrival, period))
    if mu is not None:
        claims += [NoiseBudget(mu), CovarianceBound(mu, mu)]
    return claims
