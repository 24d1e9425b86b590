"""The ``[network]`` of a scenario: arcs from a file, inline rows or a gallery network, and fixed points."""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.sparse as sp

from trigpoint import graphs
from trigpoint.errors import ArgumentError, FileFormatError
from trigpoint.graphs import EXTERNAL, MeasurementGraph
from trigpoint.io.formats import NETWORK_FORMATS, format_of
from trigpoint.io.layout import AXES, Layout
from trigpoint.io.measurements import Notes, Rows, build_network, node_indices
from trigpoint.io.sections import GALLERY, ArcRow, NetworkSection
from trigpoint.io.text import nearest, shown
from trigpoint.io.toml_lines import line_of
from trigpoint.io.toml_source import TomlSource
from trigpoint.model import Network

_ARCS = ("network", "arcs")


def network_of(source: TomlSource, section: NetworkSection) -> Network | MeasurementGraph:
    """Read or build the network that the section describes, fixed points applied."""
    if (section.arcs is None) == (section.gallery is None):
        got = "neither arcs nor gallery" if section.arcs is None else "both arcs and gallery"
        raise source.fail(("network",), f"got {got} in [network], expected one of them")
    network: Network | MeasurementGraph
    if section.gallery is not None:
        network = _gallery(source, dict(section.gallery))
    elif isinstance(section.arcs, str):
        network = _from_file(source, section.arcs)
    else:
        network = _inline(source, section.arcs)
    return _with_fixed(source, network, section.fixed) if section.fixed else network


def _from_file(source: TomlSource, name: str) -> Network | MeasurementGraph:
    path = source.path.parent / name
    try:
        chosen = format_of(path, NETWORK_FORMATS)
    except FileFormatError as error:
        raise source.fail(_ARCS, f"network.arcs: {error}") from None
    if not path.is_file():
        raise source.fail(
            _ARCS,
            f"got arcs = {shown(name)}, but there is no file {str(path)!r}; names start from the scenario's folder",
        )
    network: Network | MeasurementGraph = chosen.read(path)
    return network


# -- inline rows -------------------------------------------------------------------------------------------------------
def _inline(source: TomlSource, arcs: Any) -> Network | MeasurementGraph:
    if not isinstance(arcs, list) or not arcs:
        raise source.fail(_ARCS, f"network.arcs: got {shown(arcs)}, expected a file's name or a list of rows")
    rows = [_row(source, row, k) for k, row in enumerate(arcs)]
    size = _value_size(source, rows)
    lines = [line_of(source.lines, (*_ARCS, k)) or 1 for k in range(len(rows))]
    tail = [_name(source, row.start, k) for k, row in enumerate(rows)]
    head = [_name(source, row.to, k) for k, row in enumerate(rows)]
    if size is None:
        bare = Rows(source.path, tail, head, Layout(()), {}, lines)
        tails, heads, names = node_indices(bare, ())
        return MeasurementGraph(len(names), tails, heads, None, names)
    axes = [f"_{axis}" for axis in AXES[:size]] if size else [""]
    values, sigmas = [f"value{axis}" for axis in axes], [f"sigma{axis}" for axis in axes]
    cells: dict[str, list[str]] = {name: [] for name in (*values, *sigmas)}
    for k, row in enumerate(rows):
        for name, number in zip(values, _numbers(source, row.value, len(axes), "value", k), strict=True):
            cells[name].append(str(number))
        for name, number in zip(sigmas, _numbers(source, row.sigma, len(axes), "sigma", k), strict=True):
            cells[name].append("" if number is None else str(number))
    layout = Layout(tuple(values), tuple(sigmas))
    return build_network(Rows(source.path, tail, head, layout, cells, lines), Notes())


def _row(source: TomlSource, row: Any, k: int) -> ArcRow:
    if isinstance(row, list) and 2 <= len(row) <= 4:
        row = dict(zip(("from", "to", "value", "sigma"), row, strict=False))
    if not isinstance(row, dict):
        raise source.fail(
            (*_ARCS, k),
            f"network.arcs.{k}: got {shown(row)}, expected {{from, to, value, sigma}} or [from, to, value, sigma]",
        )
    return source.validated(ArcRow, row, (*_ARCS, k))


def _name(source: TomlSource, value: Any, k: int) -> str:
    if isinstance(value, bool) or not isinstance(value, (str, int)):
        raise source.fail((*_ARCS, k), f"network.arcs.{k}: got {shown(value)}, expected the name of a node")
    return str(value)


def _value_size(source: TomlSource, rows: list[ArcRow]) -> int | None:
    """Length of the first list of values, 0 for plain numbers, None when no row has a value."""
    given = [row.value for row in rows if row.value is not None]
    if not given:
        row = next((k for k, row in enumerate(rows) if row.sigma is not None), None)
        if row is not None:
            raise source.fail((*_ARCS, row), f"network.arcs.{row}: got a sigma without a value; add the value")
        return None
    if len(given) < len(rows):
        row = next(k for k, row in enumerate(rows) if row.value is None)
        raise source.fail((*_ARCS, row), f"network.arcs.{row}: got no value, but other rows have one; give all or none")
    return len(given[0]) if isinstance(given[0], list) else 0


def _numbers(source: TomlSource, value: Any, size: int, what: str, k: int) -> list[Any]:
    if value is None:
        return [None] * size
    if what == "sigma" and not isinstance(value, list):
        return [value] * size
    numbers = value if isinstance(value, list) else [value]
    if len(numbers) != size or size > len(AXES) or any(isinstance(number, list) for number in numbers):
        raise source.fail(
            (*_ARCS, k),
            f"network.arcs.{k}: got {what} = {shown(value)}, expected {size} numbers (1 to 3, equal in all rows)",
        )
    return numbers


# -- gallery -----------------------------------------------------------------------------------------------------------
def _gallery(source: TomlSource, table: dict[str, Any]) -> MeasurementGraph:
    at = ("network", "gallery")
    kind = table.pop("kind", None)
    if not isinstance(kind, str) or kind not in GALLERY:
        hint = nearest(kind, GALLERY) if isinstance(kind, str) else ""
        raise source.fail(
            (*at, "kind"), f"network.gallery.kind: got {shown(kind)}, expected one of {list(GALLERY)}{hint}"
        )
    section = source.validated(GALLERY[kind], table, at)
    parameters = {name: value for name in type(section).model_fields if (value := getattr(section, name)) is not None}
    if kind == "random_connected":
        parameters["rng"] = np.random.default_rng(parameters.pop("seed"))
    try:
        graph: MeasurementGraph = getattr(graphs, kind)(**parameters)
    except ArgumentError as error:
        raise source.fail(at, f"network.gallery: {error}") from None
    return graph


# -- fixed points ------------------------------------------------------------------------------------------------------
def _with_fixed(source: TomlSource, network: Network | MeasurementGraph, fixed: dict[str, Any]) -> Network:
    at = ("network", "fixed")
    if isinstance(network, MeasurementGraph):
        raise source.fail(
            at,
            "got fixed values for arcs without values, expected measured arcs; use anchors (arcs with an empty 'from')",
        )
    graph = network.graph
    added: list[tuple[int, Any]] = []
    known = list(network.known)
    exact = {int(graph.head[k]): network.values[k] for k in np.flatnonzero(network.exact)}
    readings = np.bincount(graph.head[graph.is_external], minlength=graph.n_nodes)
    for name, value in fixed.items():
        if name not in graph.names:
            raise source.fail(
                (*at, name),
                f"got the fixed point {shown(name)}, which no arc mentions{nearest(name, graph.names)}; "
                "correct the name, or leave it out",
            )
        node = graph.index(name)
        wanted = _fixed_value(source, network, name, value)
        if readings[node] == 0:
            added.append((node, wanted))
        elif readings[node] > 1 or node not in exact or not np.array_equal(exact[node], wanted):
            raise source.fail(
                (*at, name),
                f"got a fixed value of {shown(name)}, which has an absolute reading already; leave one of them out",
            )
        if node not in known:
            known.append(node)
    return _extended(network, added, known)


def _fixed_value(source: TomlSource, network: Network, name: str, value: Any) -> Any:
    numbers = np.array(value, dtype=np.float64)
    shape = network.values.shape[1:]
    if numbers.shape != shape and not (numbers.size == network.dimension == 1):
        raise source.fail(
            ("network", "fixed", name),
            f"got the value {shown(value)} of the fixed point {shown(name)}, expected {network.dimension} numbers",
        )
    return numbers.reshape(shape)


def _extended(network: Network, added: list[tuple[int, Any]], known: list[int]) -> Network:
    graph, count = network.graph, len(added)
    nodes = np.array([node for node, _ in added], dtype=np.int64)
    values = np.array([value for _, value in added], dtype=np.float64).reshape(count, *network.values.shape[1:])
    covariance = network.covariance
    if sp.issparse(covariance):
        empty = sp.csr_array((count * network.dimension, count * network.dimension))
        covariance = sp.block_diag([covariance, empty], format="csr")
    elif covariance is not None:
        covariance = np.concatenate([covariance, np.zeros((count, *covariance.shape[1:]))])
    weight = graph.weight
    if weight is not None:
        one = (
            np.ones(count) if weight.ndim == 1 else np.broadcast_to(np.eye(graph.dimension), (count, *weight.shape[1:]))
        )
        weight = np.concatenate([weight, one])
    return Network(
        MeasurementGraph(
            graph.n_nodes,
            np.concatenate([graph.tail, np.full(count, EXTERNAL)]),
            np.concatenate([graph.head, nodes]),
            weight,
            graph.names,
        ),
        np.concatenate([network.values, values]),
        covariance,
        exact=np.concatenate([network.exact, np.ones(count, dtype=np.bool_)]),
        known=known,
        positions=network.positions,
        unit=network.unit,
        title=network.title,
        columns={name: (*texts, *[""] * count) for name, texts in network.columns.items()},
    )
