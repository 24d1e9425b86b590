"""Which columns (or edge attributes) hold the measurement: value, sigma or covariance, one to three numbers an arc."""

from __future__ import annotations

import re
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from itertools import combinations_with_replacement

import numpy as np
import scipy.sparse as sp

from trigpoint.arrays import FloatArray
from trigpoint.errors import ArgumentError
from trigpoint.io.text import nearest, number_text
from trigpoint.linalg.blocks import Blocks
from trigpoint.model import Network

AXES = "xyz"
_RESERVED = re.compile(r"(value|sigma|cov)(_.*)?", re.IGNORECASE | re.DOTALL)


@dataclass(frozen=True)
class Layout:
    """Names of the columns with the values and with their spread (standard deviations, or an upper triangle)."""

    value: tuple[str, ...]
    sigma: tuple[str, ...] = ()
    cov: tuple[str, ...] = ()

    @property
    def is_scalar(self) -> bool:
        """True for one number an arc in a column ``value``; values then have shape (M,)."""
        return self.value == ("value",)

    @property
    def spread(self) -> tuple[str, ...]:
        """The columns that say how certain a value is; empty for none."""
        return self.sigma or self.cov


def layout_of(columns: Collection[str]) -> Layout:
    """Find the measurement among column names; a ``ValueError`` says what is missing, doubled or misspelt."""
    value = _group("value", columns)
    if not value:
        close = nearest("value", columns)
        raise ValueError(f"got no column 'value' (or value_x, value_y, value_z) among {sorted(columns)}{close}")
    axes = AXES[: len(value)]
    sigma, cov = _group("sigma", columns), _group("cov", columns)
    if sigma and cov:
        raise ValueError(f"got both {sigma[0]!r} and {cov[0]!r}; give standard deviations or covariances, not both")
    expected_sigma = sigma_columns(value)
    scalar_sigma = sigma == ("sigma",)
    if sigma and not scalar_sigma and sigma != expected_sigma:
        raise ValueError(f"got the columns {list(sigma)} beside {list(value)}; expected {list(expected_sigma)}")
    expected_cov = cov_columns(axes)
    if cov and (value == ("value",) or set(cov) != set(expected_cov)):
        wanted = "'sigma'" if value == ("value",) else f"{list(expected_cov)} (upper triangle, row by row)"
        raise ValueError(f"got the columns {list(cov)} beside {list(value)}; expected {wanted}")
    return Layout(value, sigma, expected_cov if cov else ())


def sigma_columns(value: Sequence[str]) -> tuple[str, ...]:
    """The standard deviations that belong to the value columns."""
    return tuple(name.replace("value", "sigma", 1) for name in value)


def cov_columns(axes: str) -> tuple[str, ...]:
    """``cov_xx, cov_xy, ...``: upper triangle, row by row."""
    return tuple(f"cov_{a}{b}" for a, b in combinations_with_replacement(axes, 2))


def is_reserved(name: str) -> bool:
    """True for names that speak of values and spreads, which no further column may have."""
    return _RESERVED.fullmatch(name) is not None


def _group(stem: str, columns: Collection[str]) -> tuple[str, ...]:
    found = [name for name in columns if (match := _RESERVED.fullmatch(name)) and match[1].lower() == stem]
    known = [stem, *(f"{stem}_{a}" for a in AXES)] if stem != "cov" else list(cov_columns(AXES))
    for name in found:
        if name not in known:
            raise ValueError(f"got the column {name!r}, expected one of {known}{nearest(name, known)}")
    if stem in found and len(found) > 1:
        raise ValueError(f"got {stem!r} beside {[n for n in found if n != stem]}; give one number an arc, or several")
    ordered = tuple(name for name in known if name in found)
    if stem != "cov" and ordered and ordered[0] != stem and ordered != tuple(known[1 : len(ordered) + 1]):
        missing = next(name for name in known[1:] if name not in found)
        raise ValueError(f"got {list(ordered)} but no column {missing!r}; the axes are x, then y, then z")
    return ordered


def network_cells(network: Network) -> tuple[Layout, dict[str, list[str]]]:
    """Values and spread of a network as texts, one entry an arc (``""`` for an exact reading).

    Raises:
        ArgumentError: more than three numbers an arc, or arcs that are correlated with each other.
    """
    size, scalar = network.dimension, network.values.ndim == 1
    if size > len(AXES):
        raise ArgumentError(f"this format holds up to {len(AXES)} numbers an arc; got {size}")
    value = ("value",) if scalar else tuple(f"value_{a}" for a in AXES[:size])
    table = network.values.reshape(network.graph.n_arcs, size)
    cells = {name: list(map(number_text, table[:, k].tolist())) for k, name in enumerate(value)}
    blocks = _blocks_to_write(network)
    if blocks is None or network.exact.all():
        return Layout(value), cells
    silent = network.exact | (~network.graph.is_external if network.covariance is None else False)
    blocks[silent] = 0.0
    sigma = np.sqrt(np.diagonal(blocks, axis1=1, axis2=2))
    diagonal = np.zeros_like(blocks)
    diagonal[:, range(size), range(size)] = sigma * sigma
    if scalar or np.array_equal(diagonal, blocks):
        layout = Layout(value, sigma=sigma_columns(value))
        spread = {name: sigma[:, k] for k, name in enumerate(layout.sigma)}
    else:
        layout = Layout(value, cov=cov_columns(AXES[:size]))
        pairs = zip(*np.triu_indices(size), strict=True)
        spread = {name: blocks[:, a, b] for name, (a, b) in zip(layout.cov, pairs, strict=True)}
    for name, numbers in spread.items():
        texts = map(number_text, numbers.tolist())
        cells[name] = ["" if skip else text for text, skip in zip(texts, silent.tolist(), strict=True)]
    return layout, cells


def _blocks_to_write(network: Network) -> FloatArray | None:
    """Blocks (M, d, d); None when nothing needs to be said (unit weights and no reading but exact ones)."""
    count, size = network.graph.n_arcs, network.dimension
    covariance = network.covariance
    if covariance is None:
        if not (network.graph.is_external & ~network.exact).any():
            return None
        # a reading without sigma would be read as exact: unit weights have to be written out for it
        return np.broadcast_to(np.eye(size), (count, size, size)).copy()
    blocks = covariance_blocks(network) if sp.issparse(covariance) else covariance.reshape(count, size, size)
    if blocks is None:
        raise ArgumentError(
            "some arcs are correlated with each other, which this format cannot hold; "
            "save the network as .json, or as .gkf for height differences"
        )
    return np.array(blocks, dtype=np.float64)


def covariance_blocks(network: Network) -> FloatArray | None:
    """Blocks (M, d, d) of a sparse joint covariance; None when arcs are correlated with each other."""
    size = network.dimension
    entries = sp.coo_array(network.covariance)
    entries.eliminate_zeros()
    rows, columns = entries.coords
    if (rows // size != columns // size).any():
        return None
    blocks = np.zeros((network.graph.n_arcs, size, size))
    blocks[rows // size, rows % size, columns % size] = entries.data
    assert Blocks(network.graph.n_arcs, size).total == entries.shape[0]
    return blocks
