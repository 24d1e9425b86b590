"""What goes wrong in ``[simulate]``: channels, clocks, topologies, absences, triggers, motion."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from trigpoint.io.section_base import Chance, Numbers, PositiveNumber, Section, Share, Size


class BurstsSection(Section):
    """``bursts`` of a channel: probabilities that a link turns bad, that it recovers, and of loss while bad."""

    begin: Chance
    end: Chance
    loss: Chance = 1.0


class OutageSection(Section):
    """One of the ``outages`` of a channel: from ``start`` to ``stop`` (s), on ``links`` [[sender, receiver], ...]."""

    start: Size
    stop: PositiveNumber
    links: list[list[Any]] | None = None


class ChannelSection(Section):
    """``channel``: loss, delay and rounding of messages, and what becomes of old ones."""

    loss: Share = 0.0
    delay: Size = 0.0
    jitter: Size = 0.0
    old: Literal["drop", "use", "propagate"] = "drop"
    stale: PositiveNumber | None = None
    bursts: BurstsSection | None = None
    outages: list[OutageSection] = Field(default_factory=list)
    reach: PositiveNumber | None = None
    axes: list[Annotated[int, Field(ge=0)]] = Field(default_factory=lambda: [0])
    quantum: Size = 0.0
    span: PositiveNumber | None = None


class ClocksSection(Section):
    """``clocks``: each a number for all nodes, or a list with one a node."""

    period: Numbers | None = None
    phase: Numbers = 0.0
    offset: Numbers = 0.0
    drift: Numbers = 0.0
    jitter: Numbers = 0.0


class ChangeSection(Section):
    """One of the ``changes`` of a topology: from ``time`` (s) on these ``arcs`` (their numbers) work."""

    time: Size
    arcs: list[Annotated[int, Field(ge=0)]]


class TopologySection(Section):
    """``topology``: random (``dwell`` seconds, ``arrival`` probability of an arc, ``seed``), or listed ``changes``.

    Or ``radius``: the arcs of bouncing agents work while their ends are at most so far apart.
    """

    dwell: PositiveNumber | None = None
    arrival: Chance | None = None
    seed: Annotated[int, Field(ge=0)] = 0
    changes: list[ChangeSection] = Field(default_factory=list)
    radius: PositiveNumber | None = None

    @model_validator(mode="after")
    def _one_kind(self) -> TopologySection:
        kinds = bool(self.changes) + (self.dwell is not None) + (self.radius is not None)
        if kinds != 1 or (self.dwell is None) != (self.arrival is None):
            raise ValueError("expected either dwell and arrival, or changes, or a radius")
        return self

    @property
    def drawn(self) -> tuple[float, float] | None:
        """``dwell`` and ``arrival`` of a random topology; None for another one."""
        return None if self.dwell is None or self.arrival is None else (self.dwell, self.arrival)


class AbsenceSection(Section):
    """One of the ``absences``: ``node`` (its name) is away from ``start`` to ``stop`` (s; for good without)."""

    node: Any
    start: Size
    stop: PositiveNumber | None = None

    @model_validator(mode="after")
    def _begins_before_it_ends(self) -> AbsenceSection:
        if self.stop is not None and self.stop <= self.start:
            got = f"start = {self.start:g} and stop = {self.stop:g}"
            raise ValueError(f"node {self.node!r}: got {got}, expected start < stop")
        return self


class TriggerSection(Section):
    """``trigger``: send when the neighbours' picture is off by ``size e^{-rate t}``."""

    size: PositiveNumber
    rate: Size = 0.0


class MotionSection(Section):
    """``motion``: a ``file`` (CSV: time, then all states node after node), or ``side`` and ``speeds`` of bouncers.

    Bouncing agents have four states, their place and velocity in a square. ``known``: the agents know how they move.
    """

    file: str | None = None
    side: PositiveNumber | None = None
    known: bool = True
    speeds: list[PositiveNumber] = Field(default_factory=lambda: [0.5, 1.0], min_length=2, max_length=2)
    seed: Annotated[int, Field(ge=0)] = 0

    @model_validator(mode="after")
    def _one_kind(self) -> MotionSection:
        if (self.file is None) == (self.side is None):
            raise ValueError("expected either a file or a side")
        return self


TROUBLES: tuple[type[Section], ...] = (
    ChannelSection,
    BurstsSection,
    OutageSection,
    ClocksSection,
    TopologySection,
    ChangeSection,
    AbsenceSection,
    TriggerSection,
    MotionSection,
)
