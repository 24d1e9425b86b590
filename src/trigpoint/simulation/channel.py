"""What happens to messages on their way, and what a node does with an old one. Pure values."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from trigpoint.errors import ArgumentError

Policy = Literal["drop", "use", "propagate"]


@dataclass(frozen=True)
class Bursts:
    """Losses in bursts (Gilbert-Elliott): each link is good or bad, and changes between two messages.

    Args:
        begin: probability that a good link turns bad.
        end: probability that a bad one turns good; the share of bad time is ``begin / (begin + end)``.
        loss: probability of loss on a bad link; a good one loses with the channel's own ``loss``.
    """

    begin: float
    end: float
    loss: float = 1.0

    def __post_init__(self) -> None:
        """Check the probabilities."""
        for name in ("begin", "end", "loss"):
            value = getattr(self, name)
            if not 0.0 < value <= 1.0:
                raise ArgumentError(f"{name} of bursts must be a probability, 0 < {name} <= 1; got {value}")


@dataclass(frozen=True)
class Outage:
    """Nothing arrives that is sent from ``start`` to before ``stop`` [s].

    Args:
        start, stop: seconds.
        links: (sender, receiver) pairs of node indices; None for all links.
    """

    start: float
    stop: float
    links: tuple[tuple[int, int], ...] | None = None

    def __post_init__(self) -> None:
        """Check the interval."""
        if not (np.isfinite(self.start) and self.start < self.stop):
            raise ArgumentError(f"an outage must stop after its start; got {self.start} to {self.stop} s")


@dataclass(frozen=True)
class Channel:
    """What the links do to messages, and what a node does with an old message.

    Args:
        loss: probability that one message to one neighbour is lost, 0 <= loss < 1; drawn for each message.
        delay: seconds from sending to arrival.
        jitter: a further delay, uniform between 0 and this many seconds; messages may overtake each other, and one that
            was sent before the last one heard is ignored.
        old: ``drop`` leaves a message out from when its successor should have arrived, ``use`` takes the last one heard
            as if it were new, ``propagate`` moves it to now by its sender's time stamp, model and input.
        stale: seconds after which ``use`` and ``propagate`` leave a message out, too; None for never.
        bursts: losses in bursts, or None.
        outages: intervals in which nothing arrives.
        reach: distance at which a link loses ``1 - 1/e`` of its messages (``1 - exp(-(d / reach)^2)``); None: any.
        axes: which states of an agent are its position, for ``reach``.
        quantum: message values are rounded to multiples of it; 0 for full precision.
        span: message values are clipped to ``[-span, span]``; None for no limit. With ``quantum`` a value takes
            ``log2(2 span / quantum + 1)`` bits.
    """

    loss: float = 0.0
    delay: float = 0.0
    jitter: float = 0.0
    old: Policy = "drop"
    stale: float | None = None
    bursts: Bursts | None = None
    outages: tuple[Outage, ...] = ()
    reach: float | None = None
    axes: tuple[int, ...] = (0,)
    quantum: float = 0.0
    span: float | None = None

    def __post_init__(self) -> None:
        """Check every number."""
        if not 0.0 <= self.loss < 1.0:
            raise ArgumentError(f"loss must be a probability, 0 <= loss < 1; got {self.loss}")
        for name in ("delay", "jitter", "quantum"):
            value = getattr(self, name)
            if not (np.isfinite(value) and value >= 0.0):
                raise ArgumentError(f"{name} must be a number of at least 0; got {value}")
        for name in ("stale", "reach", "span"):
            value = getattr(self, name)
            if value is not None and not value > 0.0:
                raise ArgumentError(f"{name} must be positive, or None; got {value}")
        if self.old not in get_args(Policy):
            raise ArgumentError(f"old must be one of {', '.join(get_args(Policy))}; got {self.old!r}")
        if self.bursts is not None and not isinstance(self.bursts, Bursts):
            raise ArgumentError(f"bursts must be Bursts(begin, end); got {self.bursts!r}")
        if not all(isinstance(outage, Outage) for outage in self.outages):
            raise ArgumentError(f"outages must be a tuple of Outage(start, stop); got {self.outages!r}")

    @property
    def is_certain(self) -> bool:
        """True where nothing is random: every message arrives, ``delay`` seconds later."""
        chancy = self.loss or self.jitter or self.bursts is not None or self.reach is not None
        return not (chancy or self.outages)

    @property
    def bits_per_value(self) -> float:
        """Bits of one value on the wire."""
        if not self.quantum or self.span is None:
            return 64.0
        return float(np.ceil(np.log2(2.0 * self.span / self.quantum + 1.0)))


@dataclass(frozen=True)
class Trigger:
    """A node sends only when its neighbours' picture of it is off by more than ``size e^{-rate t}``.

    The picture is the last message sent, moved on by the node's model (policy ``propagate``) or as it was (others).

    Args:
        size: threshold at time 0, in the state's unit.
        rate: how fast it shrinks, 1/s; below the observer's decay rate (theory 6-F6).
    """

    size: float
    rate: float = 0.0

    def __post_init__(self) -> None:
        """Check both numbers."""
        if not (np.isfinite(self.size) and self.size > 0.0 and np.isfinite(self.rate) and self.rate >= 0.0):
            raise ArgumentError(f"a trigger needs size > 0 and rate >= 0; got {self.size} and {self.rate}")
