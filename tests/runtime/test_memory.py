"""The network in memory: links only, nothing of one's own, and trouble as asked for and the same for equal seeds."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from trigpoint.errors import ArgumentError
from trigpoint.runtime import BestEffort, MemoryNetwork, Reliable
from trigpoint.runtime.memory import fits

CHAIN = [("a", "b"), ("b", "a"), ("b", "c"), ("c", "b")]


def heard(network: MemoryNetwork, name: str, pattern: str = "**") -> list[tuple[str, bytes]]:
    found: list[tuple[str, bytes]] = []
    network.transport(name).subscribe(pattern, lambda key, data: found.append((key, data)))
    return found


def test_what_takes_no_time_arrives_at_once_at_those_who_are_linked_and_listen() -> None:
    network = MemoryNetwork(CHAIN)
    own, near, far = heard(network, "a"), heard(network, "b", "x/*"), heard(network, "c")
    network.transport("a").publish("x/1", b"1")
    network.transport("a").publish("y/1", b"2")
    assert (own, near, far) == ([], [("x/1", b"1")], [])
    assert network.delivery == Reliable()


def test_late_frames_wait_for_the_clock() -> None:
    network = MemoryNetwork(CHAIN, delay=0.5)
    found = heard(network, "b")
    end = network.transport("a")
    end.publish("x", b"1")
    network.deliver(0.25)
    end.publish("x", b"2")
    network.deliver(0.5)
    assert found == [("x", b"1")]
    network.deliver(2.0)
    assert [data for _, data in found] == [b"1", b"2"]
    assert network.now == 2.0


@given(st.integers(0, 2**31), st.floats(0.0, 0.9), st.floats(0.0, 1.0))
def test_equal_seeds_give_equal_runs_and_jitter_reorders(seed, loss, jitter) -> None:
    runs = []
    for _ in range(2):
        network = MemoryNetwork(CHAIN, loss=loss, delay=0.1, jitter=jitter, seed=seed)
        found = heard(network, "b")
        end = network.transport("a")
        for k in range(40):
            network.deliver(0.01 * k)
            end.publish("x", bytes([k]))
        network.deliver(3.0)
        assert len(found) + network.lost == 40
        runs.append([data[0] for _, data in found])
    assert runs[0] == runs[1]
    assert jitter > 0.0 or runs[0] == sorted(runs[0])


def test_losses_are_as_likely_as_asked_for() -> None:
    network = MemoryNetwork(CHAIN, loss=0.2, seed=1)
    found = heard(network, "b")
    end = network.transport("a")
    for _ in range(20_000):
        end.publish("x", b"")
    assert len(found) / 20_000 == pytest.approx(0.8, abs=0.01)
    assert network.delivery == BestEffort()


def test_calm_senders_are_never_late_or_lost() -> None:
    network = MemoryNetwork(CHAIN, loss=0.9, delay=1.0, calm=["a"])
    found = heard(network, "b")
    for _ in range(50):
        network.transport("a").publish("x", b"")
    assert len(found) == 50
    both: list[bytes] = []
    end = network.transport("b")
    for pattern in ("x", "*"):
        end.subscribe(pattern, lambda _, data: both.append(data))
    network.transport("a").publish("x", b"")
    assert len(both) == 2
    end.subscribe_anew(["y"], lambda _, data: both.append(data))
    network.transport("a").publish("x", b"")
    network.transport("a").publish("y", b"")
    assert len(both) == 3


def test_a_partition_loses_what_is_sent_between_its_halves_and_nothing_else() -> None:
    network = MemoryNetwork(CHAIN)
    network.part(["a"], ["b", "c"], 1.0, 2.0)
    near, far = heard(network, "b"), heard(network, "c")
    for time in (0.5, 1.0, 1.5, 2.0):
        network.deliver(time)
        network.transport("a").publish("x", str(time).encode())
        network.transport("b").publish("y", str(time).encode())
    assert [data for _, data in near] == [b"0.5", b"2.0"]
    assert len(far) == 4


def test_a_closed_end_neither_speaks_nor_hears_and_another_takes_its_place() -> None:
    network = MemoryNetwork(CHAIN)
    found: list[bytes] = []
    end = network.transport("b")
    end.subscribe("x", lambda _, data: found.append(data))
    end.close()
    end.close()
    network.transport("a").publish("x", b"1")
    end.publish("x", b"2")
    again = heard(network, "b")
    network.transport("a").publish("x", b"3")
    assert (found, again) == ([], [("x", b"3")])


@pytest.mark.parametrize(
    ("pattern", "key", "yes"),
    [
        ("a/b", "a/b", True), ("a/b", "a/c", False), ("a/*", "a/b", True), ("a/*", "a/b/c", False), ("**", "a/b", True),
        ("a/**", "a", True), ("a/**/d", "a/b/c/d", True), ("a/**/d", "a/b/c", False), ("*/b", "a/b", True),
    ],
)  # fmt: skip
def test_patterns(pattern, key, yes) -> None:
    assert fits(tuple(pattern.split("/")), tuple(key.split("/"))) is yes


@pytest.mark.parametrize(
    ("options", "message"),
    [({"loss": 1.0}, "loss must be"), ({"delay": -1.0}, "delay must be"), ({"jitter": np.inf}, "jitter must be")],
)
def test_bad_trouble_is_refused(options, message) -> None:
    with pytest.raises(ArgumentError, match=message):
        MemoryNetwork(CHAIN, **options)
