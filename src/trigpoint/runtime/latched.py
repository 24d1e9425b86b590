"""What a node takes into its next step: its neighbours' estimates and its readings, brought to one instant."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from trigpoint.arrays import FloatArray, propagate
from trigpoint.observers.local import LocalArc, LocalObserver, LocalState, Message
from trigpoint.runtime.knowledge import Hearsay, Pull
from trigpoint.runtime.links import Heard
from trigpoint.runtime.settings import NodeSettings


@dataclass(frozen=True, eq=False)
class Reading:
    """The last reading of one arc: its ``time`` and ``value`` (p,)."""

    time: float
    value: FloatArray


@dataclass(frozen=True, eq=False)
class Latched:
    """What the next step uses.

    Attributes:
        inbox: each neighbour's estimate, moved to the instant of the own state.
        readings: by label.
        pulls: rate and uncertainty of every arc in use.
        told: self-knowledge of the neighbours at the other ends of arcs in use.
        own: time of the freshest reading of an own anchor in use; 0 for none.
        missing: labels or names of what is missing: empty when every arc is in use.
    """

    inbox: Mapping[str, Message]
    readings: Mapping[int, FloatArray]
    pulls: tuple[Pull, ...] = ()
    told: tuple[Hearsay, ...] = ()
    own: float = 0.0
    missing: tuple[str, ...] = ()


NOTHING = Latched({}, {})


def latched(
    settings: NodeSettings,
    rates: Sequence[float],
    state: LocalState,
    heard: Mapping[str, Heard],
    readings: Mapping[int, Reading],
) -> Latched:
    """What a node with these ``settings`` makes of what is fresh.

    An estimate of age a becomes ``e^{A a} z_j``, its sender's model applied; a reading of age a keeps its instant: the
    innovation of the arc is the one that both ends had then, so

    ``y + sign (C_j (e^{-A a} - I) z_j - C (e^{-A a} - I) z)``

    stands in for y, and no error is left over from the age. With the policy ``use`` both are taken as they are.

    Args:
        settings: of the node.
        rates: ``pull_rates`` of its arcs.
        state: its state z; everything is brought to the state's time.
        heard: the last estimate of each neighbour, those that are fresh.
        readings: the last reading of each arc, those that are fresh.

    We assume:
        * over the age of a reading the free motion backwards stays moderate (``e^{-A a}`` is not huge).
        * a label stands on one arc only.
    """
    inbox = {name: _now(settings, name, said, state.time) for name, said in heard.items()}
    taken = {label: reading.value for label, reading in readings.items()}
    pulls, told, missing = [], {}, []
    own = 0.0
    back: dict[float, FloatArray] = {}
    for arc, rate in zip(settings.program.arcs, rates, strict=True):
        others = [name for name, _ in arc.heard]
        lacking = [name for name in others if name not in heard]
        if lacking or (arc.label is not None and arc.label not in readings):
            missing.append(str(arc.label) if arc.label is not None and arc.label not in readings else lacking[0])
            continue
        doubt = sum(heard[name].uncertainty for name in others)
        if arc.label is not None:
            reading = readings[arc.label]
            taken[arc.label] = _then(settings, arc, reading, state, inbox, back)
            doubt += settings.overshoot * settings.deviations.get(arc.label, 0.0)
            if not others:
                own = max(own, min(reading.time, state.time))
        pulls.append(Pull(rate, doubt))
        for name in others:
            told[name] = Hearsay(heard[name].hops, heard[name].evidence, heard[name].broken)
    return Latched(inbox, taken, tuple(pulls), tuple(told.values()), own, tuple(missing))


def _now(settings: NodeSettings, name: str, said: Heard, time: float) -> Message:
    """The estimate of ``name``, moved to ``time`` by its own model and known input."""
    age, value = time - said.time, said.estimate
    if settings.old == "use" or age <= 0.0:
        return Message(name, said.sequence, said.time, value)
    if settings.program.exchange != "discrete":
        value = propagate(_model(settings, name), value, age, settings.drives.get(name))
    return Message(name, said.sequence, time, value)


def _then(
    settings: NodeSettings,
    arc: LocalArc,
    reading: Reading,
    state: LocalState,
    inbox: Mapping[str, Message],
    back: dict[float, FloatArray],
) -> FloatArray:
    """The reading that has, at the state's time, the innovation that the arc had at the reading's.

    ``back`` keeps the own way back by age: readings often share their instant.
    """
    age, program = state.time - reading.time, settings.program
    if settings.old == "use" or age <= 0.0 or program.exchange == "discrete":
        return reading.value
    if age not in back:
        drive = None if settings.input is None or program.B is None else program.B @ settings.input
        back[age] = _way_back(program.A, state.estimate, age, drive)
    shift = -(arc.output @ back[age])
    for name, rows in arc.heard:
        shift = shift + rows @ _way_back(_model(settings, name), inbox[name].estimate, age, settings.drives.get(name))
    moved: FloatArray = reading.value + arc.sign * shift
    return moved


def _way_back(A: FloatArray, value: FloatArray, age: float, drive: FloatArray | None) -> FloatArray:
    """``(e^{-A age} - I) z``, with a known input less what it has brought: from now to then."""
    then: FloatArray = propagate(A, value, -age, drive) - value
    return then


def _model(settings: NodeSettings, name: str) -> FloatArray:
    return settings.models.get(name, settings.program.A)


def pull_rates(program: LocalObserver) -> tuple[float, ...]:
    """``trace(gain C) / p`` [1/s] of every arc of the ``program``: how fast it pulls."""
    return tuple(float((arc.gain * arc.output.T).sum()) / int(arc.gain.shape[1]) for arc in program.arcs)


def is_mean(settings: NodeSettings) -> bool:
    """Whether a step with these ``settings`` takes a mean of vectors, so that ``knowledge.averaged`` is a bound.

    So it is for constants, outputs C = I at both ends, gains that are multiples of I, the exchange ``held``.
    """
    program = settings.program
    whole = np.eye(program.n_states)
    still = not program.A.any() and not any(A.any() for A in settings.models.values())
    return (
        still
        and program.exchange == "held"
        and program.acceleration is None
        and all(
            np.array_equal(arc.output, whole)
            and len(arc.heard) <= 1
            and all(np.array_equal(rows, whole) for _, rows in arc.heard)
            and arc.gain[0, 0] >= 0.0
            and np.array_equal(arc.gain, arc.gain[0, 0] * whole)
            for arc in program.arcs
        )
    )


def free_growth(program: LocalObserver) -> float:
    """Largest eigenvalue of ``(A + A') / 2`` [1/s] of the ``program``: an error e' = A e grows by no more, nor below 0.

    Maps from one exchange to the next (``discrete``) do not move between; theirs is 0.
    """
    if program.exchange == "discrete":
        return 0.0
    return max(0.0, float(np.linalg.eigvalsh(0.5 * (program.A + program.A.T))[-1]))
