"""The links of an event-driven run: what is sent, lost, rounded, and when it arrives."""

from __future__ import annotations

import heapq
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from trigpoint.arrays import FloatArray, frozen
from trigpoint.errors import ArgumentError
from trigpoint.observers.local import Message
from trigpoint.simulation.channel import Channel

HEAD_BYTES = 24
"""What a message carries beside its values: sender, sequence, time stamp."""

_SOON = 1e-12


@dataclass(eq=False)
class Wire:
    """All links, each from a sender to a receiver (node indices), with the messages on their way.

    Args:
        links: (sender, receiver) pairs; chances are drawn in this order.
        channel: what happens on them.
        rng: of everything random.
    """

    links: list[tuple[int, int]]
    channel: Channel
    rng: np.random.Generator
    sent: dict[int, int] = field(default_factory=dict)
    delivered: dict[int, int] = field(default_factory=dict)
    bytes: dict[int, int] = field(default_factory=dict)
    _bad: set[tuple[int, int]] = field(default_factory=set)
    _way: list[tuple[float, int, int, Message]] = field(default_factory=list)
    _here: list[tuple[int, Message]] = field(default_factory=list)
    _count: int = 0

    def send(
        self, time: float, messages: dict[int, Message], open_links: set[tuple[int, int]], place: FloatArray
    ) -> None:
        """Every sender in ``messages`` tells all its neighbours over the links that are open.

        Args: ``time`` now; ``place`` (N, n) true states, for losses that grow with distance.
        """
        if self.is_ideal:
            self._pass_on(messages, open_links)
            return
        for link in self._links_of(messages):
            chance, late = self._draw(link)
            if link not in open_links:
                continue
            message = self._rounded(messages[link[0]])
            self.sent[link[0]] = self.sent.get(link[0], 0) + 1
            size = HEAD_BYTES + int(np.ceil(self.channel.bits_per_value * message.estimate.shape[0] / 8.0))
            self.bytes[link[0]] = self.bytes.get(link[0], 0) + size
            if chance >= self._loss(link, time, place):
                self._count += 1
                heapq.heappush(self._way, (time + self.channel.delay + late, self._count, link[1], message))

    def _links_of(self, messages: dict[int, Message]) -> list[tuple[int, int]]:
        """The links of those who speak, in the order of all links."""
        if 4 * len(messages) > len(self._by_sender):
            return [link for link in self.links if link[0] in messages]
        places = sorted(place for sender in messages for place in self._by_sender.get(sender, ()))
        return [self.links[place] for place in places]

    @cached_property
    def _by_sender(self) -> dict[int, list[int]]:
        table: dict[int, list[int]] = {}
        for place, (sender, _) in enumerate(self.links):
            table.setdefault(sender, []).append(place)
        return table

    @cached_property
    def is_ideal(self) -> bool:
        """True where everything arrives at once, as it was sent."""
        channel = self.channel
        return channel.is_certain and not (channel.delay or channel.quantum or channel.span)

    def _pass_on(self, messages: dict[int, Message], open_links: set[tuple[int, int]]) -> None:
        sent, size = self.sent, self.bytes
        for link in self._links_of(messages):
            if link not in open_links:
                continue
            message = messages[link[0]]
            sent[link[0]] = sent.get(link[0], 0) + 1
            size[link[0]] = size.get(link[0], 0) + HEAD_BYTES + 8 * message.estimate.shape[0]
            self._here.append((link[1], message))

    def arrivals(self, time: float) -> list[tuple[int, Message]]:
        """(receiver, message) of all that has arrived by now, in the order of arrival."""
        found, self._here = self._here, []
        for receiver, _ in found:
            self.delivered[receiver] = self.delivered.get(receiver, 0) + 1
        while self._way and self._way[0][0] <= time + _SOON * max(1.0, abs(time)):
            _, _, receiver, message = heapq.heappop(self._way)
            self.delivered[receiver] = self.delivered.get(receiver, 0) + 1
            found.append((receiver, message))
        return found

    def _draw(self, link: tuple[int, int]) -> tuple[float, float]:
        """One chance (where losses are random) and one extra delay (where there is jitter); bursts begin and end."""
        channel = self.channel
        if channel.bursts is not None:
            turn = float(self.rng.random())
            if link in self._bad:
                if turn < channel.bursts.end:
                    self._bad.discard(link)
            elif turn < channel.bursts.begin:
                self._bad.add(link)
        random = channel.loss or channel.bursts is not None or channel.reach is not None
        chance = float(self.rng.random()) if random else 1.0
        return chance, channel.jitter * float(self.rng.random()) if channel.jitter else 0.0

    def _loss(self, link: tuple[int, int], time: float, place: FloatArray) -> float:
        channel = self.channel
        for outage in channel.outages:
            hit = outage.links is None or link in outage.links
            if hit and outage.start <= time < outage.stop:
                return np.inf
        loss = channel.loss
        if channel.bursts is not None and link in self._bad:
            loss = max(loss, channel.bursts.loss)
        if channel.reach is None:
            return loss
        axes = list(channel.axes)
        if max(axes) >= place.shape[1]:
            raise ArgumentError(f"axes {channel.axes} of the channel: the agents have {place.shape[1]} states")
        gap = float(((place[link[0], axes] - place[link[1], axes]) ** 2).sum())
        return 1.0 - (1.0 - loss) * float(np.exp(-gap / channel.reach**2))

    def _rounded(self, message: Message) -> Message:
        channel, value = self.channel, message.estimate
        if channel.span is not None:
            value = np.clip(value, -channel.span, channel.span)
        if channel.quantum:
            value = channel.quantum * np.round(value / channel.quantum)
        if value is message.estimate:
            return message
        return Message(message.sender, message.sequence, message.time, frozen(value))
