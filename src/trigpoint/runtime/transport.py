"""What a transport is: it moves bytes between keys, and does nothing else. No clock, no retries, no pickle."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

Sink = Callable[[str, bytes], None]
"""Called with key and bytes of whatever arrives, from any thread; it must return at once and never raise."""


@dataclass(frozen=True)
class Reliable:
    """Everything arrives in order while the link stands, later if it must."""


@dataclass(frozen=True)
class BestEffort:
    """What does not arrive at once may be lost, overtaken or doubled; nothing waits for it."""


Delivery = Reliable | BestEffort


class Transport(Protocol):
    """Moves bytes from a publisher to whoever subscribed to the key and is linked to it directly: nobody forwards.

    ``testing.check_transport`` says what every transport must do.
    """

    @property
    def delivery(self) -> Delivery:
        """What is guaranteed for a frame that is published."""
        ...

    def publish(self, key: str, data: bytes) -> None:
        """Send ``data`` to all linked subscribers of ``key``; never blocks for longer than a moment."""
        ...

    def subscribe(self, pattern: str, sink: Sink) -> None:
        """Hand to ``sink`` what others publish under ``pattern`` (``*`` one part, ``**`` any); never the own frames."""
        ...

    def close(self) -> None:
        """End all links; nothing reaches a sink afterwards."""
        ...
