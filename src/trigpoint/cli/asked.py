"""The claims that ``certify`` is asked for by options: every claim that it does not state unasked has one."""

from __future__ import annotations

from dataclasses import dataclass

from trigpoint.certificates import (
    CLAIMS,
    Claim,
    Convergence,
    CovarianceBound,
    DelayMargin,
    MeanSquareStability,
    NoiseBudget,
    Observable,
    SampledStability,
    SwitchingStability,
)
from trigpoint.errors import ArgumentError
from trigpoint.observers.network import NetworkObserver


@dataclass(frozen=True)
class Asked:
    """What was given on the command line; None where nothing was.

    Attributes:
        rate: 1/s, of ``Convergence``, in place of the design's own.
        floor, ceiling: ends of the spectrum, of ``SwitchingStability``.
        max_nodes: largest network, of ``SwitchingStability``.
        period: seconds, of ``SampledStability``; of ``MeanSquareStability`` where ``arrival`` is given.
        delay: seconds, of ``DelayMargin``.
        arrival: probability, of ``MeanSquareStability``.
        mu: noise level, of ``NoiseBudget`` and ``CovarianceBound``.
        process, measurement: noise levels of ``CovarianceBound``; 1 where only the other is given.
        observable: whether ``Observable`` is asked for.
    """

    rate: float | None = None
    floor: float | None = None
    ceiling: float | None = None
    max_nodes: int | None = None
    period: float | None = None
    delay: float | None = None
    arrival: float | None = None
    mu: float | None = None
    process: float | None = None
    measurement: float | None = None
    observable: bool = False


def claims_for(observer: NetworkObserver, asked: Asked) -> list[Claim]:
    """The claims that concern ``observer`` unasked, and one for each option of ``asked``."""
    claims: list[Claim] = [kind() for kind in CLAIMS if kind.concerns(observer)]
    if asked.rate is not None:
        claims = [Convergence(asked.rate) if isinstance(claim, Convergence) else claim for claim in claims]
    if asked.max_nodes is not None or asked.floor is not None or asked.ceiling is not None:
        claims.append(SwitchingStability(asked.floor, asked.ceiling, asked.max_nodes))
    if asked.period is not None and asked.arrival is None:
        claims = [claim for claim in claims if not isinstance(claim, SampledStability)]
        claims.append(SampledStability(asked.period))
    if asked.delay is not None:
        claims.append(DelayMargin(asked.delay))
    if asked.arrival is not None:
        if asked.period is None:
            raise ArgumentError("--arrival needs --period: seconds between two exchanges")
        claims.append(MeanSquareStability(asked.arrival, asked.period))
    return claims + _noise(asked) + ([Observable()] if asked.observable else [])


def _noise(asked: Asked) -> list[Claim]:
    claims: list[Claim] = []
    if asked.mu is not None:
        claims += [NoiseBudget(asked.mu), CovarianceBound(asked.mu, asked.mu)]
    if asked.process is not None or asked.measurement is not None:
        levels = (1.0 if level is None else level for level in (asked.process, asked.measurement))
        claims.append(CovarianceBound(*levels))
    return claims
