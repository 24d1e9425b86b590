"""What a run says of itself, in words: its attributes and its scenario."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from typing import Any

import numpy as np

from trigpoint.errors import ProtocolError
from trigpoint.observers.run import Run
from trigpoint.report._text import number, shortened
from trigpoint.simulation.channel import Channel
from trigpoint.simulation.documents import scenario_from_document
from trigpoint.simulation.scenario import Scenario
from trigpoint.simulation.topology import Absence

Rows = list[tuple[str, object]]

_WORDS = {
    "gain": "coupling gain",
    "period": "period of exchange [s]",
    "guaranteed_rate": "guaranteed decay rate [1/s]",
    "decay_rate_predicted": "predicted decay rate, in the long run [1/s]",
    "decay_rate_expected": "predicted decay rate, from the start of the run [1/s]",
    "message_age": "age of messages when used [s]",
    "reading_age": "age of readings when used [s]",
    "seed": "seed",
    "noise_process": "factor on the agents' process noise",
    "loss": "probability that a message is lost",
    "error_estimate": "estimated relative error of the numbers",
    "interrupted": "interrupted before its end",
    "rounds": "rounds of messages a period",
    "anchor_timeout": "an anchor's reading counts for [s]",
    "stale": "a message counts for [s]",
    "anchors": "nodes with an anchor",
    "start": "time 0 is [s since 1970]",
}
_CHANNEL = {
    "loss": "loss {}", "delay": "delay {} s", "jitter": "jitter {} s", "stale": "stale after {} s",
    "reach": "reach {}", "quantum": "rounded to {}", "span": "clipped at {}",
}  # fmt: skip
_SHOWN = 5


def rate_of(run: Run) -> tuple[float, str] | None:
    """The decay rate [1/s] to draw beside the error, and what it is; None where the run tells none.

    A live run's attribute ``decay_rate_predicted`` goes before ``guaranteed_rate``, which is that of its design, and
    speaks of exchange without delay.
    """
    live = run.path == "live"
    names = {"decay_rate_predicted": "predicted rate"} if live else {}
    names["guaranteed_rate"] = "designed rate, exchange without delay (slope only)" if live else "guaranteed rate"
    for key, name in names.items():
        rate = run.attributes.get(key)
        if isinstance(rate, int | float) and not isinstance(rate, bool) and np.isfinite(rate) and rate > 0.0:
            return float(rate), name
    return None


def fact_rows(run: Run, unit: str = "") -> Rows:
    """A row for each plain attribute of ``run``, and for what its scenario adds; tables of numbers are left out."""
    rows: Rows = []
    for key, value in run.attributes.items():
        if key == "scenario":
            rows += _scenario_rows(value, run.names)
        elif value is None or isinstance(value, (bool, int, float, str, np.number)):
            rows.append((_name(str(key), run, unit), _value(str(key), value)))
        elif isinstance(value, list | tuple) and len(value) <= _SHOWN and all(isinstance(one, str) for one in value):
            rows.append((_name(str(key), run, unit), shortened(", ".join(value), 60)))
    return rows


def _name(key: str, run: Run, unit: str) -> str:
    if key == "noise_measurement":
        sampled = run.attributes.get("period") is not None
        of = unit or "unit of the reading"
        what, root = ("deviation", "") if sampled else ("root of its intensity", " √s")
        return f"noise of a reading, {what} [{of}{root}]"
    if key == "guaranteed_rate" and run.path == "live":
        return "designed decay rate, exchange without delay [1/s]"
    return _WORDS.get(key, shortened(key, 80))


def _value(key: str, value: object) -> object:
    if key == "guaranteed_rate" and not value:
        return "none for such a run"
    if key == "period" and value is None:
        return "none: continuous exchange"
    if key == "start" and isinstance(value, float):
        return f"{value:.3f}"
    return shortened(value, 60) if isinstance(value, str) else value


def _scenario_rows(document: Any, names: tuple[str, ...]) -> Rows:
    try:
        scenario = scenario_from_document(document)
    except ProtocolError:
        return [("scenario", "in a form that this version does not read")]
    first, last = (number(float(scenario.times[k]), 4) for k in (0, -1))
    rows: Rows = [
        ("times asked for", f"{number(scenario.times.shape[0])}, {first} s to {last} s"),
        ("path asked for", scenario.path),
    ]
    if scenario.channel is not None:
        rows.append(("channel", _channel(scenario.channel)))
    for absence in scenario.absences[:_SHOWN]:
        rows.append(("node away", _absence(absence, names)))
    if len(scenario.absences) > _SHOWN:
        rows.append(("further absences", len(scenario.absences) - _SHOWN))
    return rows + _further(scenario)


def _further(scenario: Scenario) -> Rows:
    rows: Rows = []
    if scenario.clocks is not None:
        rows.append(("clocks", "each node its own"))
    if scenario.topology is not None:
        rows.append(("working arcs, changes", max(0, scenario.topology.times.shape[0] - 1)))
    if scenario.trigger is not None:
        size, rate = number(scenario.trigger.size, 4), number(scenario.trigger.rate, 4)
        rows.append(("a node sends when off by", f"{size} exp(\u2212{rate} t)" if scenario.trigger.rate else size))
    if scenario.gossip:
        rows.append(("gossip", "one random arc at each exchange"))
    if scenario.motion is not None:
        rows.append(
            ("motion", "given, known to the agents" if scenario.motion.known else "given, not known to the agents")
        )
    if scenario.inputs is not None:
        rows.append(("inputs", "known, constant"))
    if scenario.measurements is not None:
        rows.append(("readings", "recorded"))
    return rows


def _channel(channel: Channel) -> str:
    words = [_CHANNEL[key].format(number(float(value), 4)) for key, value in _set(channel).items() if key in _CHANNEL]
    if channel.bursts is not None:
        words.append("bursts")
    if channel.outages:
        words.append(f"{len(channel.outages)} outage{'' if len(channel.outages) == 1 else 's'}")
    return ", ".join([*words, f"old messages: {channel.old}"])


def _set(channel: Channel) -> Mapping[str, Any]:
    """The fields that are not what they are without being given."""
    given = {field.name: getattr(channel, field.name) for field in fields(channel)}
    return {key: value for key, value in given.items() if value is not None and value != 0.0}


def _absence(absence: Absence, names: tuple[str, ...]) -> str:
    name = shortened(names[absence.node], 30) if absence.node < len(names) else str(absence.node)
    until = f"to {number(absence.stop, 4)} s" if np.isfinite(absence.stop) else "on"
    return f"{name}, from {number(absence.start, 4)} s {until}"
