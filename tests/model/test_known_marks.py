"""Known marks leave the network without changing what is estimated: checked by constrained least squares."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse as sp
from hypothesis import given, settings
from hypothesis import strategies as st

from trigpoint.errors import ArgumentError
from trigpoint.graphs import EXTERNAL, MeasurementGraph
from trigpoint.model import Network
from trigpoint.testing.strategies import measurement_graphs

from .oracle import constrained_least_squares, dense_covariance


def random_covariance(rng: np.random.Generator, count: int, size: int, kind: str):
    if kind == "none":
        return None
    if kind == "blocks" and size > 1:
        roots = rng.normal(size=(count, size, size))
        return roots @ roots.transpose(0, 2, 1) + 0.2 * np.eye(size)
    if kind in ("variances", "blocks"):
        return rng.uniform(0.2, 3.0, size=count)
    root = rng.normal(size=(count * size, count * size))
    return sp.csr_array(root @ root.T / (count * size) + 0.3 * np.eye(count * size))


@st.composite
def marked_networks(draw: st.DrawFn) -> Network:
    graph = draw(measurement_graphs(min_nodes=2, max_nodes=6, externally_connected=True))
    marks = draw(st.sets(st.integers(0, graph.n_nodes - 1), max_size=graph.n_nodes - 1))
    keep = ~(graph.is_external & np.isin(graph.head, list(marks)))
    tail = np.concatenate([graph.tail[keep], np.full(len(marks), EXTERNAL)])
    head = np.concatenate([graph.head[keep], sorted(marks)]).astype(np.int64)
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    size = draw(st.sampled_from([1, 2]))
    kind = draw(st.sampled_from(["none", "variances", "blocks", "joint"]))
    covariance = random_covariance(rng, len(tail), size, kind)
    if size == 2 and kind == "variances":
        covariance = np.array([v * np.eye(2) for v in covariance])
    exact = np.arange(len(tail)) >= int(keep.sum())
    values = rng.normal(size=(len(tail), size)) if size > 1 else rng.normal(size=len(tail))
    order = rng.permutation(len(tail))
    if sp.issparse(covariance):
        places = (order[:, None] * size + np.arange(size)).ravel()
        covariance = sp.csr_array(covariance[places][:, places])
    elif covariance is not None:
        covariance = covariance[order]
    whole = MeasurementGraph(graph.n_nodes, tail[order], head[order])
    return Network(whole, values[order], covariance, exact=exact[order], known=sorted(marks))


@settings(max_examples=120)
@given(marked_networks())
def test_the_reduced_estimate_equals_the_constrained_one(network) -> None:
    full = constrained_least_squares(network)
    reduction = network.without_known_marks()
    reduced = constrained_least_squares(reduction.network)
    assert reduction.network.known == ()
    np.testing.assert_allclose(reduced, full[reduction.nodes], rtol=1e-7, atol=1e-8)
    for mark, value in network.known_values().items():
        np.testing.assert_allclose(full[mark], value, atol=1e-8)


@settings(max_examples=60)
@given(marked_networks())
def test_nodes_and_arcs_of_the_reduction_point_back(network) -> None:
    reduction = network.without_known_marks()
    graph, reduced = network.graph, reduction.network.graph
    assert sorted({*network.known, *reduction.nodes.tolist()}) == list(range(graph.n_nodes))
    assert reduced.names == tuple(graph.names[k] for k in reduction.nodes)
    marks = set(network.known)
    for new, old in enumerate(reduction.arcs.tolist()):
        ends = {int(graph.head[old])} | ({int(graph.tail[old])} - {EXTERNAL})
        free = {graph.names[k] for k in ends - marks}
        new_ends = {reduced.names[int(reduced.head[new])]}
        if not reduced.is_external[new]:
            new_ends.add(reduced.names[int(reduced.tail[new])])
        assert new_ends == free
        assert reduced.is_external[new] == (bool(graph.is_external[old]) or bool(ends & marks))


def small(covariance=None, values=(10.0, 1.0, 2.0, 3.0, 0.5)) -> Network:
    """Mark 'm' is the last node: arc m -> a, arc a -> m, arc a -> b, reading of m, reading of b."""
    graph = MeasurementGraph(3, [EXTERNAL, 2, 0, 0, EXTERNAL], [2, 0, 2, 1, 1], names=["a", "b", "m"])
    return Network(graph, values, covariance, exact=[True, False, False, False, False], known=[2])


def test_arcs_to_and_from_a_mark_on_the_last_node() -> None:
    reduction = small().without_known_marks()
    graph, values = reduction.network.graph, reduction.network.values
    found = {graph.arc_label(k): values[k] for k in range(graph.n_arcs) if not graph.arc_label(k).endswith("a")}
    readings = sorted(values[k] for k in range(graph.n_arcs) if graph.arc_label(k) == "environment -> a")
    assert readings == [10.0 - 2.0, 10.0 + 1.0]
    assert found == {"a -> b": 3.0, "environment -> b": 0.5}
    assert reduction.arcs.tolist() == [1, 2, 3, 4]


def test_a_joint_covariance_changes_sign_with_the_arc() -> None:
    joint = np.eye(5) + 0.3 * (np.ones((5, 5)) - np.eye(5))
    reduced = small(sp.csr_array(joint)).without_known_marks()
    sign = np.diag([1.0, -1.0, 1.0, 1.0])
    np.testing.assert_allclose(dense_covariance(reduced.network), sign @ joint[1:, 1:] @ sign)


def test_arcs_between_marks_correct_what_is_correlated_with_them() -> None:
    graph = MeasurementGraph(3, [EXTERNAL, EXTERNAL, 0, 0], [0, 1, 1, 2])
    values, exact = [0.0, 1.0, 1.2, 5.0], [True, True, False, False]
    joint = np.diag([1.0, 1.0, 1.0, 1.0])
    joint[2, 3] = joint[3, 2] = 0.5
    network = Network(graph, values, sp.csr_array(joint), exact=exact, known=[0, 1])
    reduced = network.without_known_marks().network
    # The arc between the marks is 0.2 too long; its twin is expected to be 0.5 * 0.2 too long.
    np.testing.assert_allclose(reduced.values, [4.9])
    np.testing.assert_allclose(dense_covariance(reduced), [[0.75]])
    np.testing.assert_allclose(constrained_least_squares(network)[2], [4.9])
    assert network.values.tolist() == values


def test_arcs_between_marks_say_nothing_when_uncorrelated() -> None:
    graph = MeasurementGraph(3, [EXTERNAL, EXTERNAL, 0, 0], [0, 1, 1, 2])
    for covariance in (None, np.ones(4), sp.eye_array(4)):
        network = Network(graph, [0.0, 1.0, 1.2, 5.0], covariance, exact=[True, True, False, False], known=[0, 1])
        reduction = network.without_known_marks()
        assert reduction.network.values.tolist() == [5.0]
        assert reduction.arcs.tolist() == [3]


def test_weights_positions_and_titles_go_along() -> None:
    source = small()
    network = Network(
        source.graph.with_weight([1, 2, 3, 4, 5]), source.values, exact=source.exact, known=[2],
        positions=[[0, 0], [1, 1], [2, 2]], unit="m", title="three",
    )  # fmt: skip
    reduced = network.without_known_marks().network
    assert reduced.graph.arc_weights.tolist() == [2, 3, 4, 5]
    assert reduced.positions.tolist() == [[0, 0], [1, 1]]
    assert (reduced.unit, reduced.title) == ("m", "three")


def test_without_marks_nothing_changes() -> None:
    network = Network(small().graph, [10.0, 1.0, 2.0, 3.0, 0.5], np.arange(1.0, 6.0))
    reduction = network.without_known_marks()
    assert np.array_equal(reduction.network.graph.tail, network.graph.tail)
    assert np.array_equal(reduction.network.graph.head, network.graph.head)
    assert np.array_equal(reduction.network.values, network.values)
    assert np.array_equal(reduction.network.covariance, network.covariance)


def test_marks_alone_leave_nothing_to_estimate() -> None:
    graph = MeasurementGraph(1, [EXTERNAL], [0])
    with pytest.raises(ArgumentError, match="every node is a known mark"):
        Network(graph, [1.0], exact=[True], known=[0]).without_known_marks()
