"""Measured networks: what is refused, precision weights, and exact readings."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse as sp

from trigpoint.errors import ArgumentError, ShapeError
from trigpoint.graphs import EXTERNAL, MeasurementGraph, chain
from trigpoint.model import Network

from .oracle import constrained_least_squares

PAIR = MeasurementGraph(2, [EXTERNAL, 0, EXTERNAL], [0, 1, 1])


@pytest.mark.parametrize(
    ("arguments", "options", "kind", "words"),
    [
        ((np.zeros(2),), {}, ShapeError, r"values must have shape \(3,\) or \(3, d\); got \(2,\)"),
        ((np.zeros((3, 1, 1)),), {}, ShapeError, "values must have shape"),
        (([0, np.nan, 0],), {}, ArgumentError, "values must be finite; got nan at position 1"),
        (([0, 1, 2], [1.0, 1.0]), {}, ShapeError, r"covariance must have shape \(3,\).*got \(2,\)"),
        ((np.zeros((3, 2)), np.ones(3)), {}, ShapeError, r"\(3, 2, 2\)"),
        (([0, 1, 2], [1.0, 0.0, 1.0]), {}, ArgumentError, r"covariance\[1\] = 0.0 must be a positive variance"),
        (([0, 1, 2], [1.0, np.inf, 1.0]), {}, ArgumentError, "covariance must be finite"),
        ((np.zeros((3, 2)), np.ones((3, 2, 2))), {}, ArgumentError, r"covariance\[0\] must be symmetric positive"),
        (
            (np.zeros((3, 2)), np.broadcast_to([[1.0, 0.5], [0.0, 1.0]], (3, 2, 2))),
            {"exact": [True, False, False]},
            ArgumentError,
            r"covariance\[1\] must be symmetric positive definite",
        ),
        (([0, 1, 2], sp.eye_array(2)), {}, ShapeError, r"covariance must have shape \(3, 3\); got \(2, 2\)"),
        (([0, 1, 2], sp.diags_array([1.0, np.nan, 1.0])), {}, ArgumentError, "covariance must be finite"),
        (
            ([0, 1, 2], sp.diags_array([1.0, 0.0, 1.0])),
            {},
            ArgumentError,
            r"covariance\[1, 1\] = 0.0 must be a positive",
        ),
        (
            ([0, 1, 2], sp.csr_array(np.eye(3) + np.eye(3, k=1) / 2)),
            {},
            ArgumentError,
            "covariance must be symmetric",
        ),
        (([0, 1, 2],), {"exact": [True]}, ShapeError, r"exact must have shape \(3,\); got \(1,\)"),
        (([0, 1, 2],), {"exact": [False, True, False]}, ArgumentError, "arc 0 -> 1 is internal and cannot be exact"),
        (([0, 1, 2],), {"known": [2]}, ArgumentError, r"known\[0\] = 2 is no index"),
        (
            ([0, 1, 2],),
            {"known": [0]},
            ArgumentError,
            "known mark '0' must have exactly one external arc, an exact one",
        ),
        (([0, 1, 2],), {"positions": np.zeros((3, 2))}, ShapeError, r"positions must have shape \(2, 2\)"),
        (([0, 1, 2],), {"positions": [["a", "b"], ["c", "d"]]}, ArgumentError, "positions must be numbers"),
        (([0, 1, 2],), {"positions": [[0, np.inf], [0, 0]]}, ArgumentError, "positions must be finite, or NaN"),
        (
            ([0, 1, 2],),
            {"columns": {"note": ["a"]}},
            ShapeError,
            r"column 'note' must hold one text an arc \(3\); got 1",
        ),
    ],
)
def test_every_refusal_says_what_is_wrong(arguments, options, kind, words) -> None:
    with pytest.raises(kind, match=words):
        Network(PAIR, *arguments, **options)


def test_two_exact_readings_of_a_node_must_agree() -> None:
    graph = MeasurementGraph(1, [EXTERNAL, EXTERNAL], [0, 0])
    Network(graph, [1.0, 1.0], exact=[True, True])
    with pytest.raises(ArgumentError, match=r"two exact readings of node '0' disagree: 1\.0 and 2\.0"):
        Network(graph, [1.0, 2.0], exact=[True, True])
    with pytest.raises(ArgumentError, match=r"known mark '0'.*got 2"):
        Network(graph, [1.0, 1.0], exact=[True, True], known=[0])


def test_unknown_places_and_the_covariance_of_exact_readings_are_accepted() -> None:
    network = Network(
        PAIR, [0, 1, 2], [0.0, 1.0, 1.0], exact=[True, False, False], positions=[[0, 0], [np.nan, np.nan]]
    )
    assert network.dimension == 1
    joint = Network(PAIR, [0, 1, 2], sp.diags_array([0.0, 1.0, 1.0]), exact=[True, False, False])
    assert isinstance(joint.covariance, sp.csr_array)
    blocks = np.stack([np.zeros((2, 2)), np.eye(2), np.eye(2)])
    assert Network(PAIR, np.zeros((3, 2)), blocks, exact=[True, False, False]).dimension == 2


# -- precision weights -------------------------------------------------------------------------------------------------
def test_precision_weights_are_inverse_variances_of_mean_one() -> None:
    weights = Network(PAIR, [0, 1, 2], [1.0, 4.0, 0.25]).precision_weights()
    assert weights.mean() == pytest.approx(1.0)
    np.testing.assert_allclose(weights / weights[0], [1.0, 0.25, 4.0])
    assert Network(PAIR, [0, 1, 2]).precision_weights() is None


def test_precision_blocks_are_inverse_covariances_of_mean_trace_d() -> None:
    rng = np.random.default_rng(0)
    roots = rng.normal(size=(3, 2, 2))
    covariance = roots @ roots.transpose(0, 2, 1) + 0.1 * np.eye(2)
    blocks = Network(PAIR, np.zeros((3, 2)), covariance).precision_weights()
    assert np.trace(blocks, axis1=1, axis2=2).mean() == pytest.approx(2.0)
    product = blocks @ covariance
    scale = product[0, 0, 0]
    np.testing.assert_allclose(product, np.broadcast_to(scale * np.eye(2), (3, 2, 2)), atol=1e-12 * scale)
    PAIR.with_weight(blocks)


def test_what_has_no_precision_weights() -> None:
    with pytest.raises(ArgumentError, match="jointly correlated arcs have no weight"):
        Network(PAIR, [0, 1, 2], sp.eye_array(3)).precision_weights()
    exact = Network(PAIR, [0, 1, 2], np.ones(3), exact=[False, False, True])
    with pytest.raises(ArgumentError, match=r"node '1' has an exact reading.*with_exact_readings_as_marks\(\)"):
        exact.precision_weights()


def test_unit_scale_does_not_change_the_least_squares_estimate() -> None:
    values, variance = np.array([0.1, 1.0, 0.9]), np.array([1.0, 4.0, 0.25])
    weights = Network(PAIR, values, variance).precision_weights()
    np.testing.assert_allclose(
        constrained_least_squares(Network(PAIR, values, variance)),
        constrained_least_squares(Network(PAIR, values, 1 / weights)),
    )


# -- exact readings become marks ---------------------------------------------------------------------------------------
def test_exact_readings_become_marks_with_one_exact_arc() -> None:
    graph = MeasurementGraph(3, [EXTERNAL, 0, EXTERNAL, 1, EXTERNAL, EXTERNAL], [2, 1, 2, 2, 0, 2])
    network = Network(
        graph, [5.0, 1.0, 5.0, 2.0, 2.1, 5.3], np.full(6, 0.1), exact=[True, False, True, False, False, False],
        columns={"note": list("abcdef")}, unit="m", title="t",
    )  # fmt: skip
    marked = network.with_exact_readings_as_marks()
    assert marked.known == (2,)
    assert marked.known_values()[2].tolist() == [5.0]
    assert marked.columns["note"] == ("a", "b", "d", "e")
    assert (marked.unit, marked.title) == ("m", "t")
    np.testing.assert_allclose(constrained_least_squares(marked), constrained_least_squares(network), atol=1e-12)


def test_a_network_without_exact_readings_has_no_marks() -> None:
    marked = Network(chain(2), [0.0, 1.0]).with_exact_readings_as_marks()
    assert marked.known == ()
    assert marked.graph.n_arcs == 2
