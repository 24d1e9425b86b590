"""What tests of time go by: when a run is repeated, whose the ports are, what effort is."""

from __future__ import annotations

import socket
from types import SimpleNamespace

import pytest

from tests import machine


class Seen:
    """A witness that has been told what to see."""

    def __init__(self, *, busy: bool) -> None:
        self.busy = busy

    def __enter__(self) -> Seen:
        return self

    def __exit__(self, *_: object) -> None:
        pass


def attempts(monkeypatch: pytest.MonkeyPatch, held: list[bool], *, busy: bool) -> list[int]:
    """Which attempts ``with_time`` makes of a run that holds as given, before it returns or fails."""
    monkeypatch.setattr(machine, "Witness", lambda: Seen(busy=busy))
    monkeypatch.setattr(machine, "settle", lambda: None)
    made: list[int] = []

    def run(attempt: int) -> None:
        made.append(attempt)
        assert held[attempt]

    if held[-1]:
        machine.with_time(run)
    else:
        with pytest.raises(AssertionError):
            machine.with_time(run)
    return made


def test_a_run_that_holds_is_made_once(monkeypatch) -> None:
    assert attempts(monkeypatch, [True], busy=True) == attempts(monkeypatch, [True], busy=False) == [0]


def test_a_run_that_fails_on_a_machine_with_time_fails_at_once(monkeypatch) -> None:
    assert attempts(monkeypatch, [False], busy=False) == [0]


def test_a_run_that_fails_on_a_busy_machine_is_repeated_and_fails_in_the_end(monkeypatch) -> None:
    assert attempts(monkeypatch, [False, False, True], busy=True) == [0, 1, 2]
    assert attempts(monkeypatch, [False] * 5, busy=True) == [0, 1, 2, 3, 4]


def test_other_errors_are_not_repeated(monkeypatch) -> None:
    monkeypatch.setattr(machine, "Witness", lambda: Seen(busy=True))

    def run(_: int) -> None:
        raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        machine.with_time(run)


def test_a_machine_is_busy_by_its_accounts_or_by_late_wakes() -> None:
    for others, late, busy in ((0.05, 0.0, False), (0.2, 0.0, True), (0.0, 0.05, True)):
        assert machine.Witness.busy.fget(SimpleNamespace(others=others, late=late)) is busy
    with machine.Witness() as witness:
        machine.unit()
    assert 0.0 <= witness.late <= 1.0
    assert "of all cores" in str(witness)


def test_no_port_is_given_twice_and_none_that_the_system_gives() -> None:
    ports = [machine.free_port(kind) for kind in (socket.SOCK_STREAM, socket.SOCK_DGRAM) for _ in range(3)]
    assert len(set(ports)) == 6
    with socket.socket() as one:
        one.bind(("127.0.0.1", 0))
        assert one.getsockname()[1] > max(ports)


def test_effort_counts_the_work_and_not_the_waiting() -> None:
    with machine.effort() as little:
        machine.until(lambda: False, within=0.2)
    with machine.effort() as much:
        for _ in range(20):
            machine.unit()
    assert little.units < much.units
    assert not machine.until(lambda: False, within=0.0)
    assert machine.until(lambda: True, within=0.0)
