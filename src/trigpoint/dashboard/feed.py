"""What a page can be fed from: a recorded run, or one that is going on. The server knows nothing else."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol, Self

import numpy as np

from trigpoint.arrays import IntArray
from trigpoint.dashboard.frames import STATES, UNKNOWN

if TYPE_CHECKING:
    from trigpoint.runtime import Controls

ORDERS = ("pause", "go", "kill", "revive")
"""What a page can ask of a node, where the feed has controls."""


@dataclass(frozen=True)
class Event:
    """Something that happened at ``time`` [s], said in ``text``, to the ``node`` of this index or to no single one."""

    time: float
    text: str
    node: int | None = None


class View(Protocol):
    """What one page looks at: a value, moved by time and by the page's commands."""

    @property
    def index(self) -> int:
        """The frame to show."""
        ...

    @property
    def wait(self) -> float:
        """Seconds until another frame may be due; infinite: not before a command."""
        ...

    @property
    def playing(self) -> bool:
        """Whether it moves by itself."""
        ...

    @property
    def speed(self) -> float:
        """Seconds of the run a second."""
        ...

    def advanced(self, seconds: float) -> Self:
        """Let ``seconds`` of real time pass."""
        ...

    def obeying(self, command: Mapping[str, Any]) -> Self:
        """Apply one of the commands play, pause, seek, speed; what cannot be done is a ``ProtocolError``."""
        ...


class Feed(Protocol):
    """A source of frames for any number of pages."""

    @property
    def controls(self) -> Controls | None:
        """What the page may do to the nodes; None: look only."""
        ...

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the nodes."""
        ...

    @property
    def edition(self) -> int:
        """How often the network has grown; with another number the topology is another one."""
        ...

    @property
    def ended(self) -> str | None:
        """Why nothing more will come, once it is so."""
        ...

    def topology(self) -> dict[str, Any]:
        """Return the message that a page gets first; ``frames`` describes it."""
        ...

    def view(self) -> View:
        """Return what a page looks at when it opens."""
        ...

    def frame(self, index: int) -> bytes:
        """Return the binary frame ``index``."""
        ...

    def traces(self, node: int) -> dict[str, Any]:
        """Return the JSON message with the history of ``node``."""
        ...

    def details(self, node: int, index: int) -> dict[str, Any]:
        """Return the JSON message with what is known of ``node`` at the frame ``index``."""
        ...

    def events(self, after: int) -> tuple[int, Sequence[Event]]:
        """Return how many events there have been, and those kept among them from number ``after`` on."""
        ...

    def ordered(self, order: str, node: int) -> None:
        """Take note that the page gave ``order`` to ``node`` and that it was carried out."""
        ...

    async def follow(self) -> None:
        """Keep the feed up to date while it is served; returns when nothing more will come."""
        ...


def changes(time: float, before: IntArray, after: IntArray, names: Sequence[str]) -> list[Event]:
    """Return the events between two tables of states: one for each node, or one for all that went the same way.

    Args:
        time: when, seconds.
        before: (N,) indices into ``STATES``.
        after: (N,) indices into ``STATES``.
        names: of the N nodes.
    """
    moved = np.flatnonzero(before != after)
    ways: dict[tuple[int, int], list[int]] = {}
    for node in moved.tolist():
        ways.setdefault((int(before[node]), int(after[node])), []).append(node)
    found = []
    for (old, new), nodes in ways.items():
        was = "" if old == UNKNOWN else f" (was {STATES[old]})"
        if len(nodes) <= 3:
            found += [Event(time, f"{names[node]}: {STATES[new]}{was}", node) for node in nodes]
        else:
            found.append(Event(time, f"{len(nodes)} nodes: {STATES[new]}{was}"))
    return found
