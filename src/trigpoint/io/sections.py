"""The tables of a scenario file as pydantic models: declared keys, strict types, frozen values."""

from __future__ import annotations

from typing import Annotated, Any, Literal

import numpy as np
from pydantic import AfterValidator, BeforeValidator, Field, model_validator

from trigpoint.arrays import FloatArray, frozen
from trigpoint.io.section_base import Numbers, PositiveNumber, Section, is_number
from trigpoint.io.text import shown
from trigpoint.io.trouble_sections import (
    TROUBLES,
    AbsenceSection,
    ChannelSection,
    ClocksSection,
    MotionSection,
    TopologySection,
    TriggerSection,
)


def _listed(value: Any) -> Any:
    """What was read before and comes again, as a section with one more option, is an array already."""
    return value.tolist() if isinstance(value, np.ndarray) else value


def _matrix(value: Any) -> FloatArray:
    rows = [[value]] if is_number(value) else _listed(value)
    whole = isinstance(rows, list) and rows and all(isinstance(row, list) and row for row in rows)
    if not whole or not all(is_number(entry) for row in rows for entry in row):
        raise ValueError(f"got {shown(value)}, expected a matrix such as [[0, 1], [0, 0]]")
    if len({len(row) for row in rows}) > 1:
        raise ValueError(f"got rows of {sorted({len(row) for row in rows})} numbers, expected rows of equal length")
    return frozen(rows)


def _covariance(value: Any) -> FloatArray:
    matrix = _matrix(value)
    square = matrix.shape[0] == matrix.shape[1]
    if not square or not np.array_equal(matrix, matrix.T) or np.linalg.eigvalsh(matrix)[0] < 0:
        raise ValueError(f"got {shown(value)}, expected a covariance: square, symmetric, no negative eigenvalue")
    return matrix


def _gain(value: Any) -> Any:
    if value in ("from-graph", "worst-case") or (is_number(value) and value > 0):
        return value
    raise ValueError(f"got {shown(value)}, expected 'from-graph', 'worst-case' or a positive number")


def _instants(value: Any) -> FloatArray:
    value = _listed(value)
    if not isinstance(value, list) or not value or not all(map(is_number, value)):
        raise ValueError(f"got {shown(value)}, expected a list of times in seconds")
    times = frozen(value)
    if times[0] < 0 or (np.diff(times) <= 0).any():
        raise ValueError(f"got {shown(value)}, expected increasing times from 0 on")
    return times


def _process(value: Any) -> Any:
    if isinstance(value, bool) or (is_number(value) and value >= 0):
        return value
    raise ValueError(f"got {shown(value)}, expected true, false or a number of at least 0")


def _spectrum(value: Any) -> Any:
    """Numbers, or pairs [real, imaginary], as complex numbers."""

    def good(entry: Any) -> bool:
        return is_number(entry) or (isinstance(entry, list) and len(entry) == 2 and all(map(is_number, entry)))

    if isinstance(value, tuple):  # read before
        return value
    if not isinstance(value, list) or not value or not all(map(good, value)):
        raise ValueError(f"got {shown(value)}, expected numbers or pairs [real, imaginary]")
    return tuple(complex(*entry) if isinstance(entry, list) else complex(entry) for entry in value)


def _arc_weights(value: Any) -> Any:
    if value == "optimal" or is_number(value):
        return value
    if isinstance(value, list) and value and all(map(is_number, value)):
        return value
    raise ValueError(f"got {shown(value)}, expected 'optimal', a number, or one number an arc")


Matrix = Annotated[Any, BeforeValidator(_matrix)]
CovarianceMatrix = Annotated[Any, BeforeValidator(_covariance)]


class AgentSection(Section):
    """``[agent]``: one agent ``x' = A x + B u + E v`` with relative output ``C x``."""

    A: Matrix
    C: Matrix
    B: Matrix | None = None
    E: Matrix | None = None


class PlantSection(Section):
    """``[plant]``: one plant seen by many agents: C_i in ``outputs``, whom agent i hears in ``neighbours``."""

    A: Matrix
    outputs: list[Matrix]
    neighbours: list[list[Annotated[int, Field(ge=0)]]]
    B: Matrix | None = None


class DesignSection(Section):
    """``[design]``: which observer, with which gain.

    ``method`` names it (the one that fits the problem unless given); ``gain`` is "from-graph" (times ``margin``),
    "worst-case" (for up to ``max_nodes`` nodes) or a number; arc ``weights`` are "unit" or "precision"; ``process`` and
    ``measurement`` are covariance matrices. Other methods take a ``rate`` (1/s), ``eigenvalues``, a ``period`` (s),
    ``rounds``, a ``scheme``, ``anchor_gain`` and ``arc_weights``; a key that the method does not take is an error.
    """

    method: Annotated[str, Field(min_length=1)] | None = None
    gain: Annotated[Any, AfterValidator(_gain)] = "from-graph"
    margin: Annotated[float, Field(ge=1)] | None = None
    max_nodes: Annotated[int, Field(ge=1)] | None = None
    weights: Literal["unit", "precision"] = "unit"
    process: CovarianceMatrix | None = None
    measurement: CovarianceMatrix | None = None
    rate: PositiveNumber | None = None
    eigenvalues: Annotated[Any, BeforeValidator(_spectrum)] | None = None
    period: PositiveNumber | None = None
    rounds: Annotated[int, Field(ge=1)] | None = None
    scheme: Annotated[str, Field(min_length=1)] | None = None
    anchor_gain: Numbers | None = None
    arc_weights: Annotated[Any, AfterValidator(_arc_weights)] | None = None


class NoiseSection(Section):
    """``noise`` in ``[simulate]``: ``process`` (on, off, or a scale), ``measurement`` (standard deviation)."""

    process: Annotated[Any, AfterValidator(_process)] = False
    measurement: Annotated[float, Field(ge=0)] = 0.0


class SimulateSection(Section):
    """``[simulate]``: when, from where, with which noise.

    ``times`` (s), or ``samples`` instants up to ``horizon`` (s); exchange ``period`` (s), None is continuous;
    ``initial_error`` and ``initial_state``, a number or a list; ``noise``; ``loss``, the fraction of messages lost;
    ``channel``, ``clocks``, ``topology``, ``absences``, ``trigger``, ``motion``, ``gossip``: what goes wrong;
    ``seed``; ``path`` of the computation, and its ``tolerance`` on large networks.
    """

    times: Annotated[Any, BeforeValidator(_instants)] | None = None
    horizon: PositiveNumber | None = None
    samples: Annotated[int, Field(ge=2)] | None = None
    period: PositiveNumber | None = None
    initial_error: Numbers | None = None
    initial_state: Numbers | None = None
    noise: NoiseSection = NoiseSection()
    loss: Annotated[float, Field(ge=0, le=1)] = 0.0
    channel: ChannelSection | None = None
    clocks: ClocksSection | None = None
    topology: TopologySection | None = None
    absences: list[AbsenceSection] = Field(default_factory=list)
    trigger: TriggerSection | None = None
    motion: MotionSection | None = None
    gossip: bool = False
    seed: Annotated[int, Field(ge=0)] = 0
    path: Literal["auto", "stacked", "modal", "reference"] = "auto"
    tolerance: Annotated[float, Field(ge=1e-14, lt=1)] = 1e-8

    @model_validator(mode="after")
    def _one_way_to_say_when(self) -> SimulateSection:
        if self.times is not None and (self.horizon is not None or self.samples is not None):
            raise ValueError("got times beside horizon or samples; give times, or horizon with samples")
        if self.channel is not None and self.loss:
            raise ValueError("got loss beside channel; write channel = {loss = ...}")
        if self.samples is not None and self.horizon is None:
            raise ValueError("got samples without horizon; give both, or times")
        return self

    @property
    def instants(self) -> FloatArray | None:
        """The times (T,) as listed, or ``samples`` (default 201) from 0 to ``horizon``; None for neither."""
        if self.times is not None:
            return np.asarray(self.times, dtype=np.float64)
        if self.horizon is None:
            return None
        return np.linspace(0.0, self.horizon, 201 if self.samples is None else self.samples)


class RunSection(Section):
    """``[run]``: live nodes.

    ``rate`` (Hz); ``transport`` of the links; ``security``, the folder that ``trigpoint keys`` wrote; what becomes of
    ``old`` messages, and after how many seconds they are left out (``stale``); ``window`` (s) that a time stamp may be
    off; ``anchor_timeout`` (s) after which a node that hears of no anchor says so; ``agents_per_process``;
    ``addresses`` of nodes by name.
    """

    rate: PositiveNumber | None = None
    transport: Literal["unixsock", "tcp", "udp", "tls", "quic"] = "unixsock"
    security: Annotated[str, Field(min_length=1)] | None = None
    old: Literal["propagate", "use"] = "propagate"
    stale: PositiveNumber | None = None
    window: PositiveNumber | None = None
    anchor_timeout: PositiveNumber | None = None
    agents_per_process: Annotated[int, Field(ge=1)] = 1
    addresses: dict[str, str] = Field(default_factory=dict)


class NetworkSection(Section):
    """``[network]``: arcs (a file's name, or rows) or a gallery, and fixed points."""

    arcs: Any = None
    fixed: dict[str, Numbers] = Field(default_factory=dict)
    gallery: dict[str, Any] | None = None


class ArcRow(Section):
    """One inline row: as an edge list's; without ``from`` an absolute reading, without any value a bare arc."""

    start: Annotated[Any, Field(alias="from")] = ""
    to: Any
    value: Numbers | None = None
    sigma: Numbers | None = None


class Document(Section):
    """The whole file."""

    network: NetworkSection | None = None
    plant: PlantSection | None = None
    agent: AgentSection | None = None
    design: DesignSection = DesignSection()
    simulate: SimulateSection | None = None
    run: RunSection | None = None


_Count = Annotated[int, Field(ge=1)]


class ChainGallery(Section):
    """Parameters of ``chain``, ``cycle``, ``complete`` and ``star``."""

    n: _Count
    anchors: list[int] | None = None


class GridGallery(Section):
    """Parameters of ``grid``."""

    rows: _Count
    cols: _Count
    anchors: list[int] | None = None


class RandomGallery(Section):
    """Parameters of ``random_connected``; the generator is seeded here."""

    n: _Count
    connectivity: Annotated[float, Field(gt=0, le=1)]
    seed: Annotated[int, Field(ge=0)] = 0


class RadiusGallery(Section):
    """Parameters of ``within_radius``."""

    positions: Matrix
    radius: PositiveNumber
    anchors: list[int] | None = None
    anchor_positions: Matrix | None = None


SECTIONS: tuple[type[Section], ...] = (
    NetworkSection,
    AgentSection,
    DesignSection,
    SimulateSection,
    NoiseSection,
    *TROUBLES,
    RunSection,
)
"""The models that stand inside others, by which an unknown key finds its table's known ones."""

GALLERY: dict[str, type[Section]] = {
    "chain": ChainGallery,
    "cycle": ChainGallery,
    "complete": ChainGallery,
    "star": ChainGallery,
    "grid": GridGallery,
    "random_connected": RandomGallery,
    "within_radius": RadiusGallery,
}
"""Parameters of each gallery network, by the function of ``trigpoint.graphs`` that makes it."""
