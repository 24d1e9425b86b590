"""Height networks of GNU Gama (``.gkf``): levelled height differences, fixed points and observed heights.

Heights and differences are metres, ``stdev`` millimetres, ``dist`` kilometres, covariance matrices square millimetres;
the network that comes out is in metres. Any other kind of observation is refused by name.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from decimal import Decimal
from pathlib import Path

import numpy as np
import scipy.linalg
import scipy.sparse as sp

from trigpoint.arrays import FloatArray
from trigpoint.errors import FileFormatError
from trigpoint.graphs import EXTERNAL, MeasurementGraph
from trigpoint.io.text import nearest, parse_number, read_bytes, shown
from trigpoint.io.xml_events import parse_xml
from trigpoint.linalg.blocks import diagonal_of
from trigpoint.model import Network

_CLUSTERS = ("height-differences", "coordinates", "obs")
_PLAIN = (
    "gama-local",
    "gama-xml",
    "network",
    "description",
    "parameters",
    "points-observations",
    "point",
    "dh",
    "cov-mat",
)
_OTHER_OBSERVATIONS = ("direction", "distance", "angle", "s-distance", "z-angle", "azimuth", "vectors", "vec")
_COMPASS = {"e": (0, 1.0), "w": (0, -1.0), "n": (1, 1.0), "s": (1, -1.0)}


def read_gama(path: str | Path) -> Network:
    """Read the ``.gkf`` file of heights at ``path``.

    Nodes are the points that take part in the heights (``fix`` or ``adj`` with z, or used by an observation), in file
    order. Arcs are the observations in file order, then one exact external arc a fixed point; the fixed points are the
    network's known marks. A ``cov-mat`` with a band gives a sparse joint covariance. ``x``, ``y`` become positions
    (east, north) as ``axes-xy`` says.

    Raises:
        FileFormatError: with the line: not XML, a DOCTYPE, a point undeclared or declared twice, a number missing or
            bad, a fixed point without z, an observation without stdev, dist or cov-mat, any other kind of observation.
    """
    return parse_gama(read_bytes(path), path)


def parse_gama(data: bytes, path: object = "<data>") -> Network:
    """Read ``data``, the content of a ``.gkf`` file; ``path`` is what error messages call it."""
    reader = _Reader(path)
    parse_xml(path, data, reader)
    return reader.network()


@dataclass
class _Point:
    line: int
    takes_part: bool
    height: float | None
    is_fixed: bool
    place: tuple[float, float]


@dataclass
class _Observation:
    line: int
    tail: str
    head: str
    value: float
    variance: float | None


@dataclass
class _Cluster:
    line: int
    kind: str
    station: str
    observations: list[_Observation] = field(default_factory=list)
    covariance: sp.coo_array | None = None


class _Reader:
    """Collects the events of one file."""

    def __init__(self, path: object) -> None:
        self.path = path
        self.title = ""
        self.axes = "ne"
        self.sigma_apr = Decimal(10)
        self.points: dict[str, _Point] = {}
        self.clusters: list[_Cluster] = []
        self._inside: _Cluster | None = None
        self._matrix: tuple[int, int, int] = (0, 0, 0)
        self._depth = 0

    # -- events --------------------------------------------------------------------------------------------------------
    def start(self, name: str, attributes: Mapping[str, str], line: int) -> None:
        """An element opens."""
        self._depth += 1
        if self._depth == 1 and name not in ("gama-local", "gama-xml"):
            raise self._fail(f"got the document <{name}>, expected <gama-local>; is this a Gama input file?", line)
        if name in _OTHER_OBSERVATIONS:
            raise self._fail(
                f"got the observation <{name}>, expected height differences <dh> only; "
                "trigpoint reads the heights of a network, not its plane coordinates",
                line,
            )
        if name not in (*_PLAIN, *_CLUSTERS):
            raise self._fail(f"got the unknown element <{name}>{nearest(name, (*_PLAIN, *_CLUSTERS))}", line)
        if name == "network":
            self._read_axes(attributes, line)
        elif name == "parameters":
            self._read_parameters(attributes, line)
        elif name in _CLUSTERS:
            self._inside = _Cluster(line, name, attributes.get("from", "").strip())
        elif name == "point":
            self._read_point(attributes, line)
        elif name == "dh":
            self._read_difference(attributes, line)
        elif name == "cov-mat":
            self._matrix = (self._whole(attributes, "dim", line), self._whole(attributes, "band", line), line)

    def end(self, name: str, text: str) -> None:
        """An element closes."""
        self._depth -= 1
        if name == "description":
            self.title = text.strip()
        elif name == "cov-mat":
            self._read_matrix(text)
        elif name in _CLUSTERS and self._inside is not None:
            self._close_cluster(self._inside)
            self._inside = None

    # -- elements ------------------------------------------------------------------------------------------------------
    def _read_axes(self, attributes: Mapping[str, str], line: int) -> None:
        axes = attributes.get("axes-xy", "ne").strip().lower()
        if len(axes) != 2 or {_COMPASS.get(axis, (9, 0))[0] for axis in axes} != {0, 1}:
            raise self._fail(f"got axes-xy={shown(axes)}, expected two directions such as 'ne', 'en' or 'sw'", line)
        self.axes = axes

    def _read_parameters(self, attributes: Mapping[str, str], line: int) -> None:
        if "sigma-apr" in attributes:
            self.sigma_apr = self._positive(attributes, "sigma-apr", line)

    def _read_point(self, attributes: Mapping[str, str], line: int) -> None:
        name = self._name(attributes, "id", line)
        if self._inside is not None:
            self._read_reading(name, attributes, line)
            return
        other = self.points.get(name)
        if other is not None:
            raise self._fail(f"got the point {shown(name)} again, declared at line {other.line}; delete one", line)
        fixed = "z" in attributes.get("fix", "").lower()
        height = float(self._number(attributes, "z", line)) if "z" in attributes else None
        if fixed and height is None:
            raise self._fail(f"got the fixed point {shown(name)} without a height, expected z='...'", line)
        place = [np.nan, np.nan]
        if "x" in attributes and "y" in attributes:
            for key, axis in zip("xy", self.axes, strict=True):
                where, sign = _COMPASS[axis]
                place[where] = sign * float(self._number(attributes, key, line))
        takes_part = fixed or "z" in attributes.get("adj", "").lower()
        self.points[name] = _Point(line, takes_part, height, fixed, (place[0], place[1]))

    def _read_reading(self, name: str, attributes: Mapping[str, str], line: int) -> None:
        if "x" in attributes or "y" in attributes:
            raise self._fail("got observed coordinates x, y, expected observed heights z only", line)
        self._add(_Observation(line, "", name, float(self._number(attributes, "z", line)), None))

    def _read_difference(self, attributes: Mapping[str, str], line: int) -> None:
        if self._inside is None or self._inside.kind == "coordinates":
            raise self._fail("got <dh> outside <height-differences>; move it inside", line)
        known = ("from", "to", "val", "stdev", "dist", "extern")
        for key in attributes:
            if key not in known:
                raise self._fail(f"got the attribute {key!r} of <dh>, expected {known}{nearest(key, known)}", line)
        tail = self._inside.station if "from" not in attributes else self._name(attributes, "from", line)
        if not tail:
            raise self._fail("got <dh> without from='...'; name the point it starts at", line)
        head = self._name(attributes, "to", line)
        if tail == head:
            raise self._fail(f"got a self-loop from {shown(tail)} to itself, which measures nothing; delete it", line)
        value = float(self._number(attributes, "val", line))
        variance = None
        if "stdev" in attributes:
            variance = float(self._positive(attributes, "stdev", line).scaleb(-3)) ** 2
        elif "dist" in attributes:
            # Gama weights a levelled line by its length: stdev = sigma-apr * sqrt(dist in km)
            variance = float(self.sigma_apr**2 * self._positive(attributes, "dist", line) * Decimal("1e-6"))
        if variance is not None and not 0.0 < variance < np.inf:
            raise self._fail("got a stdev or dist whose variance is no positive number; check the unit", line)
        self._add(_Observation(line, tail, head, value, variance))

    def _add(self, observation: _Observation) -> None:
        if self._inside is not None:
            self._inside.observations.append(observation)

    def _read_matrix(self, text: str) -> None:
        dim, band, line = self._matrix
        if self._inside is None:
            raise self._fail("got <cov-mat> outside a cluster of observations; move it inside", line)
        if not 0 <= band < dim:
            raise self._fail(f"got dim={dim}, band={band} of <cov-mat>, expected 0 <= band < dim", line)
        words = text.split()
        expected = dim * (band + 1) - band * (band + 1) // 2
        if len(words) != expected:
            raise self._fail(
                f"got {len(words)} numbers in <cov-mat>, expected {expected} for dim={dim}, band={band} "
                "(upper part, row by row)",
                line,
            )
        rows = [k for k in range(dim) for _ in range(min(band + 1, dim - k))]
        columns = [j for k in range(dim) for j in range(k, min(k + band + 1, dim))]
        entries = np.array([float(self._decimal(word, "cov-mat", line).scaleb(-6)) for word in words])
        upper = np.zeros((band + 1, dim))
        for k, j, entry in zip(rows, columns, entries, strict=True):
            upper[band + k - j, j] = entry
        try:
            scipy.linalg.cholesky_banded(upper)
        except (np.linalg.LinAlgError, ValueError):
            raise self._fail("got a <cov-mat> that is not positive definite; check its numbers", line) from None
        half = sp.coo_array((entries, (rows, columns)), shape=(dim, dim))
        self._inside.covariance = sp.coo_array(half + sp.triu(half, 1).T)

    def _close_cluster(self, cluster: _Cluster) -> None:
        count = len(cluster.observations)
        if cluster.covariance is not None:
            if cluster.covariance.shape[0] != count:
                raise self._fail(
                    f"got a <cov-mat> of dim={cluster.covariance.shape[0]} for {count} observations in "
                    f"<{cluster.kind}>; expected dim={count}",
                    self._matrix[2],
                )
        else:
            for observation in cluster.observations:
                if observation.variance is None:
                    raise self._fail(
                        "got an observation without stdev, dist or <cov-mat>; say how certain it is", observation.line
                    )
        self.clusters.append(cluster)

    # -- numbers -------------------------------------------------------------------------------------------------------
    def _name(self, attributes: Mapping[str, str], key: str, line: int) -> str:
        name = attributes.get(key, "").strip()
        if not name:
            raise self._fail(f"got no {key}='...', expected the name of a point", line)
        return name

    def _decimal(self, text: str, key: str, line: int) -> Decimal:
        try:
            number = parse_number(text)
        except ValueError as error:
            raise self._fail(f"{key}: {error}", line) from None
        # Decimal, so that a change of unit is a shift of the decimal point and rounds once
        return Decimal(text.strip()) if number else Decimal(0)

    def _number(self, attributes: Mapping[str, str], key: str, line: int) -> Decimal:
        if key not in attributes:
            raise self._fail(f"got no {key}='...', expected a number", line)
        return self._decimal(attributes[key], key, line)

    def _positive(self, attributes: Mapping[str, str], key: str, line: int) -> Decimal:
        number = self._number(attributes, key, line)
        if not number > 0:
            raise self._fail(f"got {key}={number}, expected a positive number", line)
        return number

    def _whole(self, attributes: Mapping[str, str], key: str, line: int) -> int:
        text = attributes.get(key, "").strip()
        if not (text.isascii() and text.isdigit() and len(text) < 10):
            raise self._fail(f"got {key}={shown(text)} of <cov-mat>, expected a whole number", line)
        return int(text)

    def _fail(self, text: str, line: int | None = None) -> FileFormatError:
        return FileFormatError(self.path, text, line)

    # -- result --------------------------------------------------------------------------------------------------------
    def network(self) -> Network:
        """The network of everything read."""
        observations = [observation for cluster in self.clusters for observation in cluster.observations]
        if not observations:
            raise self._fail("got no observation, expected at least one <dh> in <height-differences>")
        self._check_points(observations)
        used = {name for observation in observations for name in (observation.tail, observation.head)}
        nodes = {name: point for name, point in self.points.items() if point.takes_part or name in used}
        index = {name: k for k, name in enumerate(nodes)}
        fixed = [name for name, point in nodes.items() if point.is_fixed]
        tail = [index.get(o.tail, EXTERNAL) for o in observations] + [EXTERNAL] * len(fixed)
        head = [index[o.head] for o in observations] + [index[name] for name in fixed]
        values = [o.value for o in observations] + [float(nodes[name].height or 0.0) for name in fixed]
        places = np.array([point.place for point in nodes.values()])
        return Network(
            MeasurementGraph(len(nodes), tail, head, None, list(nodes)),
            values,
            self._covariance(len(fixed)),
            exact=np.arange(len(values)) >= len(observations),
            known=[index[name] for name in fixed],
            positions=None if np.isnan(places).all() else places,
            unit="m",
            title=self.title,
        )

    def _check_points(self, observations: list[_Observation]) -> None:
        for observation in observations:
            for name in (observation.tail, observation.head):
                if name and name not in self.points:
                    hint = nearest(name, self.points)
                    text = f"got the point {shown(name)}, which no <point id='...'> declares{hint}"
                    raise self._fail(text, observation.line)
            if not observation.tail and self.points[observation.head].is_fixed:
                text = f"got an observed height of the fixed point {shown(observation.head)}; delete it, or the fix"
                raise self._fail(text, observation.line)

    def _covariance(self, n_fixed: int) -> sp.csr_array | FloatArray:
        blocks = []
        for cluster in self.clusters:
            if cluster.covariance is None:
                blocks.append(sp.diags_array([o.variance for o in cluster.observations]))
            else:
                blocks.append(cluster.covariance)
        joint = diagonal_of([*blocks, sp.csr_array((n_fixed, n_fixed))])
        joint.eliminate_zeros()
        diagonal: FloatArray = joint.diagonal()
        if joint.nnz == np.count_nonzero(diagonal):
            return diagonal
        return sp.csr_array(joint)
