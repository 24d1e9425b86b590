"""The claims that ``certify`` is asked for by options: every claim that it does not state unasked has one."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

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

_BEYOND = -math.ulp(0.0)
_RANGES: dict[str, tuple[float, str]] = {
    "rate": (-math.inf, "a number"),
    "delay": (_BEYOND, "seconds, 0 or more"),
    "max_nodes": (0, "a whole number, 1 or more"),
    "mu": (_BEYOND, "a noise level, 0 or more"),
    "process": (_BEYOND, "a noise level, 0 or more"),
    "measurement": (_BEYOND, "a noise level, 0 or more"),
    "observable": (-1.0, ""),
}
"""Above what an option lies, and in words; others are positive."""


@dataclass(frozen=True)
class Asked:
    """What was given on the command line; None where nothing was.

    Attributes:
        rate: 1/s, of ``Convergence``, in place of the design's own.
        floor, ceiling: ends of the spectrum, of ``SwitchingStability``.
        max_nodes: largest network, of ``SwitchingStability``.
        period: seconds, of ``SampledStability``, and of ``MeanSquareStability`` where ``arrival`` is given.
        delay: seconds, of ``DelayMargin``.
        arrival: probability, of ``MeanSquareStability``.
        mu: noise level, of ``NoiseBudget`` and ``CovarianceBound``.
        process, measurement: noise levels of ``CovarianceBound``; mu where only the other is given, 1 without mu.
        observable: whether ``Observable`` is asked for.

    Raises:
        ArgumentError: a number outside its range.
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

    def __post_init__(self) -> None:
        for field in fields(self):
            value, (least, words) = getattr(self, field.name), _RANGES.get(field.name, (0.0, "a positive number"))
            if value is not None and not (least < value < math.inf):
                raise ArgumentError(f"--{field.name.replace('_', '-')}: got {value}, expected {words}")
        if self.arrival is not None and self.arrival > 1.0:
            raise ArgumentError(f"--arrival: got {self.arrival}, expected a probability above 0, at most 1")


def claims_for(observer: NetworkObserver, asked: Asked) -> list[Claim]:
    """The claims that concern ``observer`` unasked, and one for each option of ``asked``."""
    claims: list[Claim] = [kind() for kind in CLAIMS if kind.concerns(observer)]
    if asked.rate is not None:
        claims = [Convergence(asked.rate) if isinstance(claim, Convergence) else claim for claim in claims]
    if asked.max_nodes is not None:
        claims.append(SwitchingStability(max_nodes=asked.max_nodes))
    if asked.floor is not None or asked.ceiling is not None:
        claims.append(SwitchingStability(asked.floor, asked.ceiling))
    if asked.period is not None:
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
        claims.append(NoiseBudget(asked.mu))
    if any(level is not None for level in (asked.mu, asked.process, asked.measurement)):
        other = 1.0 if asked.mu is None else asked.mu
        levels = (other if level is None else level for level in (asked.process, asked.measurement))
        claims.append(CovarianceBound(*levels))
    return claims
