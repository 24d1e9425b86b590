"""From a file to problem, method and scenario: the only place that joins the spokes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TypeVar

import numpy as np
from pydantic import ValidationError

from trigpoint.errors import ArgumentError, FileFormatError
from trigpoint.graphs import MeasurementGraph
from trigpoint.io import ScenarioFile, load
from trigpoint.io.section_base import Section
from trigpoint.io.sections import DesignSection, RunSection, SimulateSection
from trigpoint.io.toml_lines import KeyPath
from trigpoint.model import HyperNetwork, LinearAgent, Network, NetworkedAgents, SharedPlant
from trigpoint.observers import AssembledObserver, DiffusiveObserver, LocalObserver, Run
from trigpoint.observers.assembled import Problem
from trigpoint.observers.certificate import Certificate


@dataclass(frozen=True, eq=False)
class Given:
    """What a file of a network holds: the drawn graph, the measured network if there are values, agent and choices."""

    path: Path
    graph: MeasurementGraph
    network: Network | None
    agent: LinearAgent
    design: DesignSection
    simulate: SimulateSection
    run: RunSection = field(default_factory=RunSection)
    lines: Mapping[KeyPath, int] = field(default_factory=dict)

    @property
    def problem(self) -> NetworkedAgents:
        """The agents on the whole drawn network (marks included), unit weights unless the file sets weights."""
        return NetworkedAgents(self.graph, self.agent)


@dataclass(frozen=True, eq=False)
class Stated:
    """What a file of another problem holds (a shared plant, agents that differ): the problem and the choices."""

    path: Path
    problem: SharedPlant | HyperNetwork | NetworkedAgents
    design: DesignSection
    simulate: SimulateSection
    run: RunSection = field(default_factory=RunSection)
    lines: Mapping[KeyPath, int] = field(default_factory=dict)


def read_any(path: Path) -> Given | Stated:
    """Read any file that states a problem of any kind."""
    loaded = load(path)
    if isinstance(loaded, ScenarioFile) and loaded.plant is not None:
        simulate, run = loaded.simulate or SimulateSection(), loaded.run or RunSection()
        return Stated(path, loaded.plant, loaded.design, simulate, run, loaded.lines)
    if isinstance(loaded, SharedPlant | HyperNetwork):
        return Stated(path, loaded, DesignSection(), SimulateSection())
    if isinstance(loaded, NetworkedAgents) and not loaded.is_homogeneous:
        return Stated(path, loaded, DesignSection(), SimulateSection())
    return read(path)


def read(path: Path) -> Given:
    """Read any file that states a network of equal agents; a document of another kind is an error."""
    loaded = load(path)
    agent, design, simulate, run = None, DesignSection(), SimulateSection(), RunSection()
    lines: Mapping[KeyPath, int] = {}
    if isinstance(loaded, ScenarioFile):
        agent, design, lines = loaded.agent, loaded.design, loaded.lines
        simulate, run = loaded.simulate or simulate, loaded.run or run
        if loaded.network is None:
            raise FileFormatError(path, "states a [plant]; this command needs a [network]")
        loaded = loaded.network
    elif isinstance(loaded, NetworkedAgents):
        return Given(path, loaded.graph, None, loaded.agent, design, simulate)
    if isinstance(loaded, Network):
        agent = agent or LinearAgent.static(loaded.dimension)
        return Given(path, loaded.graph, loaded, agent, design, simulate, run, lines)
    if isinstance(loaded, MeasurementGraph):
        agent = agent or LinearAgent.static(loaded.dimension)
        return Given(path, loaded, None, agent, design, simulate, run, lines)
    raise FileFormatError(
        path,
        f"holds {kind_of(loaded)}; this command needs a network or a scenario",
    )


def kind_of(loaded: object) -> str:
    """What a file holds, in plain words."""
    words = {
        AssembledObserver: "an observer",
        Certificate: "a certificate",
        DiffusiveObserver: "an observer",
        LocalObserver: "a node file",
        HyperNetwork: "a problem",
        MeasurementGraph: "a network without values",
        SharedPlant: "a problem",
        Network: "a network",
        NetworkedAgents: "a problem",
        Run: "a recorded run",
        ScenarioFile: "a scenario",
    }
    return words.get(type(loaded), f"a {type(loaded).__name__}")


def measured(given: Given) -> Network:
    """The measured network, or an error that says that there are no values."""
    if given.network is None:
        raise FileFormatError(given.path, "has no measured values; this command needs them (column 'value')")
    return given.network


@dataclass(frozen=True, eq=False)
class Estimating:
    """The part of the network that estimates, with the observer's weights.

    Attributes:
        problem: agents on the estimating nodes.
        network: their measurements, or None.
        marks: number of known marks that announce their value and estimate nothing.
    """

    problem: Problem
    network: Network | None
    marks: int

    @property
    def graph(self) -> MeasurementGraph | None:
        """The graph of a network of agents, with the observer's weights; None for other problems."""
        return self.problem.graph if isinstance(self.problem, NetworkedAgents) else None


def estimating(given: Given, weights: str) -> Estimating:
    """Take out the known marks and set the arcs' weights.

    ``precision`` takes 1/sigma^2 scaled to mean 1; an exact reading would weigh infinitely much, so that its node
    becomes a known mark.
    """
    network = given.network
    if network is None:
        if weights == "precision":
            raise FileFormatError(given.path, "has no sigma, so weights = 'precision' has nothing to go by")
        return Estimating(given.problem, None, 0)
    if weights == "precision":
        network = network.with_exact_readings_as_marks()
    marks = len(network.known)
    part = network.without_known_marks().network if marks else network
    graph = part.graph
    if weights == "precision":
        precision = part.precision_weights()
        if precision is None:
            raise FileFormatError(given.path, "has no sigma, so weights = 'precision' has nothing to go by")
        graph = graph.with_weight(precision)
    return Estimating(NetworkedAgents(graph, given.agent), part, marks)


def part_of(given: Given | Stated, design: DesignSection) -> Estimating:
    """What estimates, of a file of any kind."""
    if isinstance(given, Given):
        return estimating(given, design.weights)
    if design.weights == "precision":
        raise FileFormatError(given.path, "states no measured network, so weights = 'precision' has nothing to go by")
    return Estimating(given.problem, None, 0)


def changed(design: DesignSection, **options: object) -> DesignSection:
    """The design section with the command line's own options, checked like a file's."""
    given = {key: value for key, value in options.items() if value is not None}
    if "gain" in given:
        given["gain"] = _number_or_word(str(given["gain"]))
        if isinstance(given["gain"], float) and "margin" in given:
            raise ArgumentError("--margin belongs to --gain from-graph or worst-case; a given gain is taken as it is")
    return with_options(design, given)


S = TypeVar("S", bound=Section)


def with_options(section: S, given: Mapping[str, object]) -> S:
    """A file's section with what the command line gives instead, checked like the file's own."""
    try:
        return type(section).model_validate({**section.model_dump(exclude_none=True), **given})
    except ValidationError as error:
        first = error.errors()[0]
        said = first["msg"].removeprefix("Value error, ")
        if not first["loc"]:
            raise ArgumentError(said) from error
        option = "--" + str(first["loc"][0]).replace("_", "-")
        if not said.startswith("got "):
            said = f"got {first['input']!r}, expected {said.removeprefix('Input should be ')}"
        raise ArgumentError(f"{option}: {said}") from error


def _number_or_word(text: str) -> object:
    try:
        return float(text)
    except ValueError:
        return text


def instants(simulate: SimulateSection, rate: float) -> np.ndarray:
    """Output times: the scenario's, or 201 from 0 to the time in which the guaranteed rate gains six decades."""
    if simulate.instants is not None:
        return simulate.instants
    horizon = np.log(1e6) / rate if rate > 0 else 10.0
    return np.linspace(0.0, float(f"{horizon:.3g}"), 201)
