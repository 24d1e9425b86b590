"""``NodeStatus``: what a node says of its own health, as the values of a STATUS frame and back."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from trigpoint.arrays import FloatArray, frozen
from trigpoint.errors import ArgumentError, ProtocolError
from trigpoint.observers.local import LocalObserver
from trigpoint.runtime.codec import MOST_VALUES, Frame, Kind, require_name
from trigpoint.runtime.gate import REASONS, Counters
from trigpoint.runtime.links import State

STATUS_FIELDS: tuple[str, ...] = (
    "anchored", "covered", "paused", "hops", "uncertainty", "evidence_age", "acts", "missed", "step_us", "resets",
    "innovation", "clock_offset", "floor", "magnitude", "accepted", *REASONS,
)  # fmt: skip
"""The first values of a STATUS frame, in this order; a frame's facts and head come before them."""

LINK_FIELDS: tuple[str, ...] = ("state", "age", "received", "lost", "round_trip", "offset")
"""Then these for each neighbour, in the order of ``program.hears``; -1 where an age or round trip is not known."""

MOST_NEIGHBOURS = (MOST_VALUES - len(STATUS_FIELDS)) // len(LINK_FIELDS)
"""Neighbours that a live node can hear: its status holds a row for each, in one frame."""

FLOOR_SHARE = 0.01
"""A clock offset whose predicted error floor exceeds this share of the estimate is warned about."""

CLOCKS_APART = 0.05
"""Seconds of offset from which on a neighbour that answers but is not LIVE is put down to the clocks."""


def require_frames(program: LocalObserver) -> None:
    """Refuse a ``program`` whose estimate or status fits no frame, before a process trips over it.

    Raises:
        ArgumentError: too long a name, too many states or too many neighbours.
    """
    require_name(program.name)
    if program.n_states > MOST_VALUES:
        raise ArgumentError(
            f"node {program.name!r} has {program.n_states} states; a live node has at most {MOST_VALUES}, since its "
            "estimate travels in one frame: use a method whose nodes estimate their own part only"
        )
    if len(program.hears) > MOST_NEIGHBOURS:
        raise ArgumentError(
            f"node {program.name!r} hears {len(program.hears)} neighbours; a live node hears at most {MOST_NEIGHBOURS}"
            ": leave arcs out, or give the node's part to several"
        )


@dataclass(frozen=True)
class LinkStatus:
    """A node's link to one neighbour.

    Attributes:
        neighbour: its name.
        state: see ``links.TABLE``.
        age: seconds since the instant that its last estimate is for; None where there is none.
        received, lost: estimates so far; ``lost`` counts those that came too late, too.
        round_trip: smallest of the last round trips [s], or None.
        offset: its clock less the own [s], or None.
    """

    neighbour: str
    state: State
    age: float | None
    received: int
    lost: int
    round_trip: float | None
    offset: float | None


@dataclass(frozen=True)
class NodeStatus:
    """What one node says of itself.

    Attributes:
        name: the node.
        time: seconds, by its clock.
        anchored: it knows of an anchor reading that is at most ``anchor_timeout`` old; otherwise its estimate is
            relative only.
        covered: anchored, and the gain's guarantee covers the arcs at work now.
        paused: it hears, but neither steps nor speaks.
        hops: arcs to the nearest anchor, or None.
        uncertainty: root mean square error of one state that it believes to have.
        evidence_age: age of the freshest anchor reading it knows of [s], or None.
        acts: acts so far; missed: acts that were left out because the one before came too late.
        step_us: microseconds of an act, as the host measures it (smoothed).
        resets: times that the estimate ran out of range and began anew.
        innovation: Euclidean norm of all innovations at work.
        clock_offset: the largest offset of a neighbour's clock, in size [s].
        floor: error floor that this offset causes by itself, ``|offset| |A z|``.
        magnitude: Euclidean norm of z.
        counters: frames accepted and dropped.
        links: one for each neighbour that is heard.
    """

    name: str
    time: float
    anchored: bool
    covered: bool
    paused: bool
    hops: int | None
    uncertainty: float
    evidence_age: float | None
    acts: int
    missed: int
    step_us: float
    resets: int
    innovation: float
    clock_offset: float
    floor: float
    magnitude: float
    counters: Counters
    links: tuple[LinkStatus, ...]

    @property
    def warning(self) -> str | None:
        """What somebody should look at, or None."""
        for link in self.links:
            if link.state is not State.LIVE and link.offset is not None and abs(link.offset) > CLOCKS_APART:
                return (
                    f"{link.neighbour!r} answers {self.name!r}, but its estimates are not in time: their clocks differ "
                    f"by {abs(link.offset):.3g} s; synchronize the clocks"
                )
        if self.floor > FLOOR_SHARE * self.magnitude:
            return (
                f"the clocks of {self.name!r} and a neighbour differ by {self.clock_offset:.3g} s: expect an error of "
                f"about {self.floor:.3g}; synchronize the clocks"
            )
        return None

    def to_values(self) -> FloatArray:
        """The values of a STATUS frame: ``STATUS_FIELDS``, then ``LINK_FIELDS`` for each link."""
        numbers = [
            self.anchored, self.covered, self.paused, -1 if self.hops is None else self.hops, self.uncertainty,
            _or_none(self.evidence_age), self.acts, self.missed, self.step_us, self.resets, self.innovation,
            self.clock_offset, self.floor, self.magnitude, self.counters.accepted,
            *(self.counters.rejected[reason] for reason in REASONS),
        ]  # fmt: skip
        for link in self.links:
            offset = 0.0 if link.offset is None else link.offset
            numbers += [
                link.state, _or_none(link.age), link.received, link.lost, _or_none(link.round_trip), offset,
            ]  # fmt: skip
        return frozen(numbers)


def node_status(frame: Frame, hears: Sequence[str]) -> NodeStatus:
    """Read a STATUS ``frame`` of a node that ``hears`` these neighbours.

    Raises:
        ProtocolError: another kind of frame, another number of values, or a number that means nothing.
    """
    fixed = len(STATUS_FIELDS)
    expected = fixed + len(LINK_FIELDS) * len(hears)
    if frame.kind is not Kind.STATUS or frame.values.shape[0] != expected:
        raise ProtocolError(
            f"a status of a node with {len(hears)} neighbours is a STATUS frame of {expected} values; got "
            f"{frame.kind.name} with {frame.values.shape[0]}"
        )
    values = frame.values.tolist()
    told = dict(zip(STATUS_FIELDS, values[:fixed], strict=True))
    rows = [values[k : k + len(LINK_FIELDS)] for k in range(fixed, expected, len(LINK_FIELDS))]
    try:
        links = tuple(_link(name, row) for name, row in zip(hears, rows, strict=True))
    except ValueError as error:
        raise ProtocolError(f"a status of {frame.sender!r}: {error}") from error
    return NodeStatus(
        name=frame.sender,
        time=frame.time,
        anchored=told["anchored"] != 0.0,
        covered=told["covered"] != 0.0,
        paused=told["paused"] != 0.0,
        hops=None if told["hops"] < 0.0 else int(told["hops"]),
        acts=int(told["acts"]),
        missed=int(told["missed"]),
        resets=int(told["resets"]),
        uncertainty=told["uncertainty"],
        step_us=told["step_us"],
        innovation=told["innovation"],
        clock_offset=told["clock_offset"],
        floor=told["floor"],
        magnitude=told["magnitude"],
        evidence_age=_known(told["evidence_age"]),
        counters=_counters(told),
        links=links,
    )


def _counters(told: Mapping[str, float]) -> Counters:
    return Counters(int(told["accepted"]), {reason: int(told[reason]) for reason in REASONS})


def _link(name: str, row: Sequence[float]) -> LinkStatus:
    state, age, received, lost, round_trip, offset = row
    trip = _known(round_trip)
    return LinkStatus(
        name, State(int(state)), _known(age), int(received), int(lost), trip, None if trip is None else offset
    )


def _or_none(value: float | None) -> float:
    return -1.0 if value is None else max(0.0, value)


def _known(value: float) -> float | None:
    return None if value < 0.0 else value
