"""The links of an event-driven run: what is sent, lost, rounded, and when it arrives."""

from __future__ import annotations

import heapq
import math
from functools import cached_property

import numpy as np

from trigpoint.arrays import FloatArray, frozen
from trigpoint.errors import ArgumentError
from trigpoint.observers.local import Message
from trigpoint.simulation.channel import Bursts, Channel

HEAD_BYTES = 24
"""What a message carries beside its values: sender, sequence, time stamp."""

_SOON = 1e-12


class Wire:
    """All links, each from a sender to a receiver (node indices), with the messages on their way.

    ``sent``, ``delivered`` and ``bytes`` are each node's numbers so far.

    Args:
        links: (sender, receiver) pairs; chances are drawn in this order.
        channel: what happens on them.
        rng: of everything random.
        n_nodes: how many nodes there are.
    """

    def __init__(
        self, links: list[tuple[int, int]], channel: Channel, rng: np.random.Generator, n_nodes: int
    ) -> None:  # fmt: skip
        self._links, self._channel, self._rng = links, channel, rng
        self.sent, self.delivered, self.bytes = ([0] * n_nodes for _ in range(3))
        self._bad: set[tuple[int, int]] = set()
        self._way: list[tuple[float, int, int, Message]] = []
        self._here: list[tuple[int, Message]] = []
        self._count = 0
        bursts, reach = channel.bursts is not None, channel.reach is not None
        self._is_chancy = bursts or reach or channel.loss > 0.0
        self._varies = bursts or reach or bool(channel.outages)
        self._draws_of_a_link = bursts + self._is_chancy + (channel.jitter > 0.0)

    def send(
        self, time: float, messages: dict[int, Message], open_links: set[tuple[int, int]], place: FloatArray
    ) -> None:
        """Every sender in ``messages`` tells all its neighbours over the links that are open.

        Args: ``time`` now; ``place`` (N, n) true states, for losses that grow with distance.
        """
        channel, links, due = self._channel, self._links_of(messages), time + self._channel.delay
        draws = iter(self._rng.random(self._draws_of_a_link * len(links)).tolist() if self._draws_of_a_link else ())
        said = {sender: self._packed(message) for sender, message in messages.items()}
        for link in links:
            if channel.bursts is not None:
                self._turn(link, next(draws), channel.bursts)
            chance = next(draws) if self._is_chancy else 1.0
            arrival = due + channel.jitter * next(draws) if channel.jitter else due
            if link not in open_links:
                continue
            sender, receiver = link
            message, size = said[sender]
            self.sent[sender] += 1
            self.bytes[sender] += size
            if chance < (self._loss(link, time, place) if self._varies else channel.loss):
                continue
            if arrival <= time:
                self._here.append((receiver, message))
            else:
                self._count += 1
                heapq.heappush(self._way, (arrival, self._count, receiver, message))

    def _links_of(self, messages: dict[int, Message]) -> list[tuple[int, int]]:
        """The links of those who speak, in the order of all links."""
        if 4 * len(messages) > len(self._by_sender):
            return [link for link in self._links if link[0] in messages]
        places = [place for sender in messages for place in self._by_sender.get(sender, ())]
        return [self._links[place] for place in sorted(places)]

    @cached_property
    def _by_sender(self) -> dict[int, list[int]]:
        table: dict[int, list[int]] = {}
        for place, (sender, _) in enumerate(self._links):
            table.setdefault(sender, []).append(place)
        return table

    def arrivals(self, time: float) -> list[tuple[int, Message]]:
        """(receiver, message) of all that has arrived by now, in the order of arrival."""
        found, self._here = self._here, []
        while self._way and self._way[0][0] <= time + _SOON * max(1.0, abs(time)):
            found.append(heapq.heappop(self._way)[2:])
        for receiver, _ in found:
            self.delivered[receiver] += 1
        return found

    def _turn(self, link: tuple[int, int], chance: float, bursts: Bursts) -> None:
        """A good link turns bad or a bad one good, or neither."""
        if link in self._bad:
            if chance < bursts.end:
                self._bad.discard(link)
        elif chance < bursts.begin:
            self._bad.add(link)

    def _loss(self, link: tuple[int, int], time: float, place: FloatArray) -> float:
        channel = self._channel
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

    def _packed(self, message: Message) -> tuple[Message, int]:
        """The message as it is sent, rounded, and its bytes."""
        channel, value = self._channel, message.estimate
        size = HEAD_BYTES + math.ceil(channel.bits_per_value * value.shape[0] / 8.0)
        if channel.span is not None:
            value = np.clip(value, -channel.span, channel.span)
        if channel.quantum:
            value = channel.quantum * np.round(value / channel.quantum)
        if value is message.estimate:
            return message, size
        return Message(message.sender, message.sequence, message.time, frozen(value)), size
