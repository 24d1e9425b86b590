"""Scenario files: one TOML text with the network, the agent, the design, the simulation and the run.

Unknown keys are errors with the line and the nearest known key. Fixed points, arcs and gallery networks are checked
here; what a method or a transport means is checked by who uses it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from trigpoint.errors import ArgumentError
from trigpoint.graphs import MeasurementGraph
from trigpoint.io.scenario_network import network_of
from trigpoint.io.sections import AgentSection, DesignSection, Document, PlantSection, RunSection, SimulateSection
from trigpoint.io.text import read_text
from trigpoint.io.toml_lines import KeyPath
from trigpoint.io.toml_source import TomlSource
from trigpoint.model import LinearAgent, Network, SharedPlant


@dataclass(frozen=True, eq=False)
class ScenarioFile:
    """A scenario read from the file ``path``.

    ``network`` is a ``Network`` where the arcs have values (fixed points are known marks, each with one exact external
    arc), else a bare ``MeasurementGraph``. ``agent`` is None without ``[agent]``; ``simulate`` and ``run`` likewise;
    ``design`` has its defaults without ``[design]``. A file has ``[network]`` or ``[plant]``; the other is None.
    ``lines`` holds the line of every table, key and list entry by its path, such as ``("simulate", "loss")``.
    """

    path: Path
    network: Network | MeasurementGraph | None = None
    plant: SharedPlant | None = None
    agent: LinearAgent | None = None
    design: DesignSection = field(default_factory=DesignSection)
    simulate: SimulateSection | None = None
    run: RunSection | None = None
    lines: Mapping[KeyPath, int] = field(default_factory=dict)

    @property
    def graph(self) -> MeasurementGraph | None:
        """The graph of the network, with or without values."""
        return self.network.graph if isinstance(self.network, Network) else self.network


def read_scenario(path: str | Path) -> ScenarioFile:
    """Read the scenario file at ``path``; file names in it are relative to its folder.

    Raises:
        FileFormatError: with the line: no TOML, an unknown key (and the nearest known one), a wrong type, NaN or
            infinity, arcs that cannot be read, a fixed point that does not exist or contradicts a reading.
    """
    return parse_scenario(read_text(path), path)


def parse_scenario(text: str, path: str | Path) -> ScenarioFile:
    """Read a scenario from ``text``; ``path`` names it in messages, and file names in it are relative to its folder."""
    source = TomlSource(Path(path), text)
    document = source.validated(Document, source.table, ())
    if (document.network is None) == (document.plant is None):
        got = "neither" if document.plant is None else "both"
        raise source.fail(("plant",), f"got {got} of [network] and [plant], expected one of them")
    return ScenarioFile(
        path=Path(path),
        network=None if document.network is None else network_of(source, document.network),
        plant=None if document.plant is None else _plant(source, document.plant),
        agent=None if document.agent is None else _agent(source, document.agent),
        design=document.design,
        simulate=document.simulate,
        run=document.run,
        lines=source.lines,
    )


def _agent(source: TomlSource, section: AgentSection) -> LinearAgent:
    try:
        return LinearAgent(section.A, section.C, section.B, section.E)
    except ArgumentError as error:
        raise source.fail(("agent", str(error).split()[0]), str(error)) from None


def _plant(source: TomlSource, section: PlantSection) -> SharedPlant:
    if len(section.neighbours) != len(section.outputs):
        raise source.fail(
            ("plant", "neighbours"),
            f"plant.neighbours: got {len(section.neighbours)} lists, expected one an agent of outputs "
            f"({len(section.outputs)})",
        )
    try:
        return SharedPlant(section.A, section.outputs, dict(enumerate(section.neighbours)), section.B)
    except ArgumentError as error:
        raise source.fail(("plant", str(error).split()[0]), str(error)) from None
