"""Writing height networks for GNU Gama."""

from __future__ import annotations

from decimal import Decimal
from pathlib import Path

import numpy as np
import scipy.sparse as sp

from trigpoint.arrays import IntArray
from trigpoint.errors import ArgumentError
from trigpoint.io.atomic import write_atomically
from trigpoint.io.text import number_text, shown
from trigpoint.io.xml_events import escape
from trigpoint.model import Network


def write_gama(network: Network, path: str | Path) -> None:
    """Write a height ``network`` as ``.gkf`` to ``path``; ``gama_text`` says what the format can hold."""
    write_atomically(path, gama_text(network))


def gama_text(network: Network) -> str:
    """Return a height ``network`` as a ``.gkf`` document; ``parse_gama`` gives it back.

    Internal arcs become ``<dh>``, exact readings fixed points, other readings a ``<coordinates>`` cluster: read back,
    the arcs stand in that order. Without a covariance every stdev is 1 m (unit weights). Further columns are not
    written.

    Raises:
        ArgumentError: more than one number an arc, another unit than m, arc weights, a reading beside an exact one of
            the same node, readings correlated with differences, a name that XML cannot hold.
    """
    _check(network)
    graph = network.graph
    inner = np.flatnonzero(~graph.is_external)
    readings = np.flatnonzero(graph.is_external & ~network.exact)
    joint = _joint(network)
    if joint[inner][:, readings].nnz:
        raise ArgumentError("a .gkf file cannot hold readings correlated with differences; save the network as .json")
    lines = [
        '<?xml version="1.0" encoding="UTF-8"?>',
        '<gama-local xmlns="http://www.gnu.org/software/gama/gama-local">',
        '<network axes-xy="en">',
        f"<description>{escape(network.title, 'the title')}</description>" if network.title else "",
        "<points-observations>",
        *_points(network),
        *_differences(network, inner, joint),
        *_readings(network, readings, joint),
        "</points-observations>",
        "</network>",
        "</gama-local>",
    ]
    return "\n".join(line for line in lines if line) + "\n"


def _check(network: Network) -> None:
    graph = network.graph
    if network.dimension != 1:
        raise ArgumentError(f"a .gkf file holds heights, one number an arc; got {network.dimension}")
    if network.unit not in ("", "m"):
        raise ArgumentError(f"a .gkf file is in metres; got the unit {network.unit!r}: convert the values first")
    if graph.weight is not None:
        raise ArgumentError(
            "a .gkf file holds standard deviations, not arc weights; save as .json, "
            "or leave the weights out with graph.with_weight(None)"
        )
    if not (~network.exact).any():
        raise ArgumentError("the network has nothing but exact readings; a .gkf file holds at least one observation")
    count = np.bincount(graph.head[graph.is_external], minlength=graph.n_nodes)
    several = [node for node in np.unique(graph.head[network.exact]).tolist() if count[node] > 1]
    if several:
        raise ArgumentError(
            f"node {graph.names[several[0]]!r} has an exact reading and another one, but a fixed point of a .gkf file "
            "has no readings; use with_exact_readings_as_marks()"
        )
    for name in graph.names:
        if not name or name != name.strip():
            raise ArgumentError(f"the name {shown(name)} is empty or has blanks around it; rename the node")


def _joint(network: Network) -> sp.csr_array:
    if network.covariance is None:
        return sp.csr_array(sp.eye_array(network.graph.n_arcs))
    if sp.issparse(network.covariance):
        joint = sp.csr_array(network.covariance, copy=True)
        joint.eliminate_zeros()
        return joint
    return sp.csr_array(sp.diags_array(np.asarray(network.covariance).ravel()))


def _points(network: Network) -> list[str]:
    graph = network.graph
    fixed = {int(graph.head[k]): float(network.values.ravel()[k]) for k in np.flatnonzero(network.exact)}
    lines = []
    for node, name in enumerate(graph.names):
        place = ""
        if network.positions is not None and np.isfinite(network.positions[node]).all():
            x, y = (number_text(p) for p in network.positions[node])
            place = f' x="{x}" y="{y}"'
        status = f' z="{number_text(fixed[node])}" fix="z"' if node in fixed else ' adj="z"'
        lines.append(f'<point id="{escape(name, "the name")}"{place}{status}/>')
    return lines


def _differences(network: Network, arcs: IntArray, joint: sp.csr_array) -> list[str]:
    if not arcs.size:
        return []
    graph, values = network.graph, network.values.ravel()
    names = [escape(name) for name in graph.names]
    block = joint[arcs][:, arcs]
    correlated = bool(sp.triu(block, 1).nnz)
    spread = np.sqrt(block.diagonal())
    lines = []
    for k, arc in enumerate(arcs.tolist()):
        stdev = "" if correlated else f' stdev="{_shifted(spread[k], 3)}"'
        ends = f'from="{names[graph.tail[arc]]}" to="{names[graph.head[arc]]}"'
        lines.append(f'<dh {ends} val="{number_text(values[arc])}"{stdev}/>')
    matrix = _matrix(block) if correlated else []
    return ["<height-differences>", *lines, *matrix, "</height-differences>"]


def _readings(network: Network, arcs: IntArray, joint: sp.csr_array) -> list[str]:
    if not arcs.size:
        return []
    graph, values = network.graph, network.values.ravel()
    lines = [
        f'<point id="{escape(graph.names[graph.head[arc]])}" z="{number_text(values[arc])}"/>' for arc in arcs.tolist()
    ]
    return ["<coordinates>", *lines, *_matrix(joint[arcs][:, arcs]), "</coordinates>"]


def _matrix(block: sp.csr_array) -> list[str]:
    dim = block.shape[0]
    entries = sp.coo_array(block)
    band = int(np.abs(entries.coords[0] - entries.coords[1]).max(initial=0))
    table = sp.csr_array(block)
    lines = [f'<cov-mat dim="{dim}" band="{band}">']
    for k in range(dim):
        row = table[[k]].toarray()[0, k : k + band + 1]
        lines.append(" ".join(_shifted(entry, 6) for entry in row))
    return [*lines, "</cov-mat>"]


def _shifted(value: float, digits: int) -> str:
    """The number times 10^digits, without rounding it again."""
    return str(Decimal(number_text(value)).scaleb(digits))
