"""From a scenario to a ``LivePlan``: what each node's process is told, and what the simulated plant is."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from trigpoint.arrays import FloatArray
from trigpoint.cli.compose import Estimating, Given, Stated
from trigpoint.cli.simulating import scenario_of
from trigpoint.errors import ArgumentError
from trigpoint.io.sections import DesignSection, RunSection
from trigpoint.observers import AssembledObserver, DiffusiveObserver
from trigpoint.observers.aged import settling
from trigpoint.observers.network import NetworkObserver
from trigpoint.runtime.endpoints import require_safe
from trigpoint.runtime.keys import find_identity, make_keys
from trigpoint.runtime.plan import LivePlan, free_addresses, linked
from trigpoint.runtime.plant import PlantSettings
from trigpoint.runtime.settings import Identity, NodeSettings
from trigpoint.runtime.topics import written
from trigpoint.runtime.truth import Instrument, Part
from trigpoint.runtime.viewer import Viewer
from trigpoint.simulation import Scenario
from trigpoint.simulation.world import World, start_of, truth_of

DEFAULT_RATE = 20.0
_SECURED = ("tls", "quic")
_WATCHER, _PLANT, _VIEWER = "supervisor", "plant", "monitor"


@dataclass(frozen=True, eq=False)
class Design:
    """What was designed, of which file.

    Attributes:
        given: the file.
        part: what estimates.
        choices: how it was designed.
        observer: the result.
    """

    given: Given | Stated
    part: Estimating
    choices: DesignSection
    observer: NetworkObserver

    @cached_property
    def programs(self) -> AssembledObserver:
        """The nodes' programs; other observers cannot run live, each for a reason that the error says."""
        observer = self.observer
        if isinstance(observer, DiffusiveObserver):
            observer = observer.as_programs()
        if not isinstance(observer, AssembledObserver):
            raise ArgumentError(f"the method {observer.method!r} does not give each node a program of its own; "
                                "run one that does, local-kalman for instance")  # fmt: skip
        if observer.is_discrete:
            raise ArgumentError(
                f"the method {observer.method!r} designs maps from one exchange to the next, which need everybody to "
                "exchange at the same instant; live nodes have no common clock: use local-kalman, integrator, "
                "sampled or heterogeneous"
            )
        return observer


@dataclass(frozen=True)
class Places:
    """Where a run keeps what.

    Attributes:
        folder: settings, outputs, status.
        sockets: socket files; its path is short.
        allow_plain: whether plain text may leave the machine.
    """

    folder: Path
    sockets: Path
    allow_plain: bool = False


def rate_of(section: RunSection, design: Design) -> float:
    """Exchanges a second: as asked, as the observer was designed for, as simulated, or 20."""
    designed, simulated = design.programs.period, design.given.simulate.period
    rate = section.rate or (1.0 / (designed or simulated or 1.0 / DEFAULT_RATE))
    if designed is not None and abs(rate * designed - 1.0) > 1e-9:
        raise ArgumentError(f"the observer was designed for a period of {designed:g} s; got a rate of {rate:g} Hz")
    return float(rate)


def anchor_timeout(count: int, period: float, stale: float) -> float:
    """Seconds without news of an anchor after which a node calls itself relative.

    News goes one node further in a ``period``, so the ``count`` nodes of any network that results pass it on within
    ``count - 1`` of them; five more and ``stale`` [s] are for waiting and loss. At least 1 s.
    """
    return max(1.0, (count + 4) * period + stale)


def plan_of(design: Design, section: RunSection, places: Places) -> LivePlan:
    """The plan: one settings value a node, each with its own arcs and its neighbours' names and nothing else."""
    observer, period = design.programs, 1.0 / rate_of(section, design)
    scenario = _scenario(design, period)
    world = World.of(observer, scenario)
    truth = truth_of(world, scenario.initial_state)
    names = observer.names
    plant, watcher, viewer = (_free_name(wanted, names) for wanted in (_PLANT, _WATCHER, _VIEWER))
    guests = {plant: "sensor", watcher: "supervisor", viewer: "monitor"}
    network = design.given.path.stem
    identities = _identities(section, places.folder, names, guests, viewer)
    addresses = free_addresses(section.transport, names, places.sockets, section.addresses)
    watching = free_addresses(section.transport, [watcher, plant], places.sockets / "watch")
    for name, address in (*addresses.items(), (watcher, watching[watcher])):
        require_safe(address, identities.get(name), allow_plain=places.allow_plain)
    starts, spread = _starts(observer, world, scenario, truth)
    deviations = _deviations(observer, design, scenario)
    common = _common(design, section, period)
    nodes = [
        replace(
            common,
            network=network,
            program=program,
            start=start,
            start_uncertainty=spread,
            deviations={label: deviations[label] for label in program.reads if label in deviations},
            models=_models(program.hears, observer, k),
            identity=identities.get(program.name),
            guests=guests,
        )
        for k, (program, start) in enumerate(zip(observer.nodes, starts, strict=True))
    ]
    settings = PlantSettings(
        network,
        plant,
        period,
        *_plant_parts(world, scenario, truth, period),
        _shows(world, names),
        scenario.seed,
        peers={**addresses, watcher: watching[watcher]},
        listen=watching[plant],
        guests={viewer: "monitor"},
        identity=identities.get(plant),
    )
    motions = {name: settings.parts[part].A for name, part in settings.shows}
    outside = Viewer(network, viewer, plant, watching[plant], motions, identities.get(viewer))
    return LivePlan(
        network, linked(nodes, addresses), settings, places.folder, watcher, watching[watcher], identities.get(watcher),
        section.agents_per_process, motions, plant, outside,
    )  # fmt: skip


def _scenario(design: Design, period: float) -> Scenario:
    plain = {"times": None, "horizon": 1.0, "samples": 2, "period": period, "path": "reference"}
    quiet: dict[str, Any] = {"channel": None, "loss": 0.0, "clocks": None, "topology": None, "absences": [],
                             "trigger": None, "motion": None, "gossip": False}  # fmt: skip
    section = design.given.simulate.model_copy(update={**plain, **quiet})
    return scenario_of(design.given, design.part, design.observer, section)


def ignored_troubles(design: Design) -> list[str]:
    """Keys of ``[simulate]`` that say what goes wrong there; a live run takes what really happens."""
    section = design.given.simulate
    keys = ("channel", "loss", "clocks", "topology", "absences", "trigger", "motion", "gossip")
    return [key for key in keys if getattr(section, key)]


def _common(design: Design, section: RunSection, period: float) -> NodeSettings:
    """What all nodes are told alike; the program is a placeholder that every node replaces."""
    observer = design.programs
    static = all(not node.A.any() for node in observer.nodes)
    everywhere = static or design.choices.gain == "worst-case"
    stale = section.stale or max(0.25, 4.0 * period)
    rate = max(0.0, float(observer.decay_rate))
    # Messages that are a whole period old on average: half of it for the phases, half for the way.
    known = section.old == "propagate" and not static
    settle, overshoot = settling(observer, period, period, period, rate) if known else (0.0, 1.0)
    busiest = max(len(node.reads) + len(node.hears) for node in observer.nodes)
    return NodeSettings(
        design.given.path.stem,
        observer.nodes[0],
        period,
        old=section.old,
        stale=stale,
        window=section.window or 1.0,
        anchor_timeout=section.anchor_timeout or anchor_timeout(len(observer.nodes), period, stale),
        coverage="every" if everywhere else "nominal",
        status_every=max(0.25, len(observer.nodes) / 400.0),
        ping_every=max(1.0, len(observer.nodes) / 100.0),
        rate_limit=max(1000.0, 10.0 * (busiest + 4) / period),
        decay_rate=rate,
        settle_rate=settle,
        overshoot=overshoot,
        nodes=len(observer.nodes),
        max_nodes=0 if static else design.choices.max_nodes or 0,
    )


def _starts(
    observer: AssembledObserver, world: World, scenario: Scenario, truth: FloatArray
) -> tuple[list[FloatArray], float]:
    """First estimates, and a bound of their errors (root mean square of one state) while no state grows.

    Simulated truth: the scenario's initial error away from it; measured networks: zero.
    """
    shown = world.shown(truth)
    sizes = [_rms(x) for x in shown]
    if world.recorded is not None:
        return [np.zeros(node.n_states) for node in observer.nodes], max(sizes)
    errors = start_of(world, "initial_error", scenario.initial_error)
    starts = [observer.target(k) @ (x + e) for k, (x, e) in enumerate(zip(shown, errors, strict=True))]
    return starts, max(size + _rms(x + e) for size, x, e in zip(sizes, shown, errors, strict=True))


def _rms(vector: FloatArray) -> float:
    return float(np.sqrt(np.mean(vector**2)))


def _deviations(observer: AssembledObserver, design: Design, scenario: Scenario) -> dict[int, float]:
    """Standard deviation of one component of the reading of each arc: root mean square over its components."""
    readings = observer.channels.readings
    if scenario.noise is not None and scenario.noise.measurement:
        return dict.fromkeys(range(readings.count), scenario.noise.measurement)
    network = design.part.network
    if scenario.measurements is None or network is None or network.covariance is None:
        return {}
    covariance = network.covariance
    if isinstance(covariance, np.ndarray):
        variances = covariance if covariance.ndim == 1 else np.trace(covariance, axis1=1, axis2=2) / network.dimension
    else:
        variances = covariance.diagonal().reshape(readings.count, -1).mean(axis=1)
    return {label: float(np.sqrt(variance)) for label, variance in enumerate(variances)}


def _models(hears: Sequence[str], observer: AssembledObserver, own: int) -> dict[str, FloatArray]:
    """Dynamics of the neighbours that move otherwise than the node itself."""
    position = {name: k for k, name in enumerate(observer.names)}
    A = observer.nodes[own].A
    others = {name: observer.nodes[position[name]].A for name in hears}
    return {name: other for name, other in others.items() if not np.array_equal(A, other)}


def _plant_parts(
    world: World, scenario: Scenario, truth: FloatArray, period: float
) -> tuple[tuple[Part, ...], tuple[Instrument, ...]]:
    process = 0.0 if scenario.noise is None else scenario.noise.process
    factors = world.noise_factors(process, period) if process else [None] * len(world.parts)
    parts = tuple(
        Part(part.A, truth[part.place], factor) for part, factor in zip(world.parts, factors, strict=True)
    )  # fmt: skip
    deviation = 0.0 if scenario.noise is None else scenario.noise.measurement
    C, readings = world.channels.C.tocsr(), world.channels.readings
    starts = np.array([part.place.start for part in world.parts])
    found = []
    for label in range(readings.count):
        place = readings.slice(label)
        if place.start == place.stop:
            continue
        rows, recorded = C[place, :], None if world.recorded is None else world.recorded[place]
        touched = sorted({int(k) for k in np.searchsorted(starts, rows.indices, side="right") - 1})
        blocks = tuple((k, rows[:, world.parts[k].place].toarray()) for k in touched)
        found.append(Instrument(label, blocks, deviation, recorded))
    return parts, tuple(found)


def _shows(world: World, names: Sequence[str]) -> tuple[tuple[str, int], ...]:
    """One shared plant is what everybody estimates; else each node estimates its own part."""
    alone = len(world.parts) == 1
    return tuple((name, 0 if alone else k) for k, name in enumerate(names))


def _free_name(wanted: str, names: Sequence[str]) -> str:
    while wanted in names:
        wanted += "_"
    return wanted


def _identities(
    section: RunSection, folder: Path, names: Sequence[str], guests: Mapping[str, str], optional: str
) -> Mapping[str, Identity]:
    """Certificates where the transport shows them: those of ``security``, else made for this run alone.

    Without one for ``optional`` the run can only not be watched from outside.
    """
    if section.transport not in _SECURED:
        if section.security is not None:
            raise ArgumentError(f"security belongs to the transports {' and '.join(_SECURED)}; got {section.transport}")
        return {}
    if section.security is None:
        return make_keys(folder / "keys", names, guests=guests, overwrite=True)
    keys = Path(section.security)
    wanted = [*names, *(guest for guest in guests if guest != optional or (keys / f"{written(guest)}.pem").exists())]
    return {name: find_identity(keys, name) for name in wanted}
