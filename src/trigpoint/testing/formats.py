"""Axioms of a file format."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import scipy.sparse as sp

from trigpoint.arrays import FloatArray
from trigpoint.io import Format, write_atomically
from trigpoint.linalg.blocks import Blocks, block_diagonal
from trigpoint.model import Network


def check_format(file_format: Format, network: Network, folder: Path) -> None:
    """Write ``network`` and read it back: names, arcs, values and covariance must be the same.

    Values agree to the last bit, covariances to 1e-12 relative (a file may hold standard deviations); without a
    covariance the unit matrix counts, so a format may write it out. The covariance of exact readings is not used.

    Args:
        file_format: a format with ``read`` and ``write``.
        network: what to write; it must be something that the format can hold.
        folder: an existing folder for the file.
    """
    assert file_format.write is not None, f"{file_format.name} does not write"
    path = folder / f"conformance{file_format.suffixes[0]}"
    write_atomically(path, file_format.write(network))
    again = file_format.read(path)
    assert isinstance(again, Network), f"{file_format.name} read {type(again).__name__}"
    assert sorted(again.graph.names) == sorted(network.graph.names), "node names differ"
    assert _rows(again) == _rows(network), "arcs or values differ"
    gap = _covariance_gap(again, network)
    assert gap <= 1e-12, f"covariances differ by {gap:.3g} relative"
    marks = [sorted(each.graph.names[k] for k in each.known) for each in (again, network)]
    assert marks[0] == marks[1], f"known marks differ: {marks[0]} against {marks[1]}"


def _rows(network: Network) -> list[tuple[str, tuple[float, ...], bool]]:
    keys = _keys(network)
    return [keys[k] for k in _order(network)]


def _keys(network: Network) -> list[tuple[str, tuple[float, ...], bool]]:
    values = network.values.reshape(network.graph.n_arcs, network.dimension)
    labels = [network.graph.arc_label(k) for k in range(network.graph.n_arcs)]
    return [
        (label, tuple(np.asarray(value).tolist()), bool(exact))
        for label, value, exact in zip(labels, values, network.exact, strict=True)
    ]


def _order(network: Network) -> list[int]:
    keys = _keys(network)
    return sorted(range(len(keys)), key=lambda k: keys[k])


def _covariance_gap(one: Network, other: Network) -> float:
    left, right = _sorted_covariance(one), _sorted_covariance(other)
    size = np.sqrt(np.outer(np.diag(right), np.diag(right)))
    return float(np.divide(np.abs(left - right), size, out=np.abs(left - right), where=size > 0).max(initial=0.0))


def _sorted_covariance(network: Network) -> FloatArray:
    """The covariance as one dense matrix, its arcs in the order of ``_rows``, exact readings 0."""
    size, count, given = network.dimension, network.graph.n_arcs, network.covariance
    if given is None:
        whole = np.eye(count * size)
    elif sp.issparse(given):
        whole = given.toarray()
    else:
        whole = block_diagonal(given.reshape(count, size, size)).toarray()
    whole = whole * np.outer(*(np.repeat(~network.exact, size),) * 2)
    rows = Blocks(count, size).positions(np.array(_order(network), dtype=np.int64))
    ordered: FloatArray = whole[np.ix_(rows, rows)]
    return ordered
