"""The conformance kit for file formats, on every format that writes measured networks, and on formats that lose."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
import scipy.sparse as sp

from trigpoint.graphs import EXTERNAL, MeasurementGraph
from trigpoint.io import FORMATS
from trigpoint.io.formats import NETWORK_FORMATS
from trigpoint.model import Network
from trigpoint.testing import check_format

WRITING = sorted(name for name in NETWORK_FORMATS if FORMATS[name].write is not None)
VECTORS = [name for name in WRITING if name not in ("gkf", "xml")]


def heights(covariance=(1e-6, 4e-6, 2.25e-6, 9e-6, 1.0, 1e-4)) -> Network:
    """Parallel arcs, one known mark, one soft absolute reading on the last node; names that need quoting."""
    graph = MeasurementGraph(
        4, [0, 1, 1, 2, EXTERNAL, EXTERNAL], [1, 0, 2, 3, 0, 3], names=["A 1", "b,c", "\u00fc", "x<y"]
    )
    values = [0.1, -0.30000000000000004, 1 / 3, 2e-7, 437.596, 438.0]
    exact = [False] * 4 + [True, False]
    return Network(graph, values, covariance, exact=exact, known=[0], unit="m", title="Four heights")


def vectors() -> Network:
    rng = np.random.default_rng(0)
    graph = MeasurementGraph(3, [0, 1, EXTERNAL], [1, 2, 2], names=["a", "b", "c"])
    root = rng.normal(size=(3, 2, 2))
    return Network(graph, rng.normal(size=(3, 2)), np.eye(2) + root @ root.transpose(0, 2, 1))


def test_the_list_is_not_empty() -> None:
    assert {"csv", "tsv", "gkf", "json", "graphml"} <= set(WRITING)


@pytest.mark.parametrize("name", WRITING)
def test_every_writing_format_keeps_a_height_network(tmp_path, name) -> None:
    check_format(FORMATS[name], heights(), tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == [f"conformance{FORMATS[name].suffixes[0]}"]


@pytest.mark.parametrize("name", VECTORS)
def test_formats_for_vectors_keep_blocks(tmp_path, name) -> None:
    check_format(FORMATS[name], vectors(), tmp_path)


@pytest.mark.parametrize("name", WRITING)
def test_unit_weights_may_be_written_out(tmp_path, name) -> None:
    graph = MeasurementGraph(2, [0, EXTERNAL], [1, 0], names=["a", "b"])
    check_format(FORMATS[name], Network(graph, [1.5, 2.5], exact=[False, True], known=[0], unit="m"), tmp_path)


def test_joint_covariances_are_compared_too(tmp_path) -> None:
    joint = sp.csr_array(np.diag([1.0, 2.0, 3.0, 4.0, 1.0, 5.0]) + np.eye(6, k=1) * 0.25 + np.eye(6, k=-1) * 0.25)
    check_format(FORMATS["json"], heights(joint), tmp_path)


def losing(change) -> object:
    """The CSV format, but what is read back is changed."""
    good = FORMATS["csv"]
    return dataclasses.replace(good, read=lambda path: change(good.read(path)))


def rebuilt(network: Network, **changes) -> Network:
    fields = {key: getattr(network, key) for key in ("graph", "values", "covariance", "exact", "known", "unit")}
    fields.update(changes)
    return Network(fields.pop("graph"), fields.pop("values"), fields.pop("covariance"), **fields)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda n: n.graph, "csv read MeasurementGraph"),
        (
            lambda n: rebuilt(n, graph=MeasurementGraph(4, n.graph.tail, n.graph.head, names=["p", "q", "r", "s"])),
            "node names differ",
        ),
        (lambda n: rebuilt(n, values=np.nextafter(n.values, np.inf)), "arcs or values differ"),
        (lambda n: rebuilt(n, covariance=np.ones(6), exact=np.zeros(6, bool), known=[]), "arcs or values differ"),
        (
            lambda n: rebuilt(
                n,
                graph=MeasurementGraph(
                    4,
                    [*n.graph.head[:4].tolist(), EXTERNAL, EXTERNAL],
                    n.graph.tail[:4].tolist() + n.graph.head[4:].tolist(),
                    names=n.graph.names,
                ),
            ),
            "arcs or values differ",
        ),
        (lambda n: rebuilt(n, covariance=n.covariance * (1 + 1e-9)), "covariances differ by 1e-09 relative"),
        (lambda n: rebuilt(n, covariance=None), r"covariances differ by \d"),
        (lambda n: rebuilt(n, known=[]), r"known marks differ: \[\] against \['A 1'\]"),
    ],
)
def test_a_format_that_loses_something_fails(tmp_path, change, words) -> None:
    with pytest.raises(AssertionError, match=words):
        check_format(losing(change), heights(), tmp_path)


def test_a_format_that_only_reads_fails(tmp_path) -> None:
    with pytest.raises(AssertionError, match="toml does not write"):
        check_format(FORMATS["toml"], heights(), tmp_path)
