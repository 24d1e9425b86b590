"""What ``LocalKalman`` and its gain rules refuse: each message names the requirement, what was got and the remedy."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from trigpoint.analysis import smallest_eigenvalue
from trigpoint.errors import ArgumentError, MethodError, ShapeError
from trigpoint.graphs import MeasurementGraph, chain, cycle
from trigpoint.methods import METHODS, Family, Fixed, FromGraph, LocalKalman, Method, WorstCase, design
from trigpoint.model import LinearAgent, NetworkedAgents

from .drawn import DOUBLE_INTEGRATOR, FALLING

STATIC = LinearAgent.static()


def refused(problem, method, *words: str) -> None:
    with pytest.raises(MethodError) as caught:
        design(problem, method)
    text = str(caught.value)
    assert caught.value.method in text
    assert caught.value.requirement in text
    for word in words:
        assert word in text, text


# -- the verb ----------------------------------------------------------------------------------------------------------
def test_a_method_class_is_no_method() -> None:
    with pytest.raises(
        ArgumentError, match=r"one of LocalKalman, .*; got the class LocalKalman itself; write LocalKalman\(\)"
    ):
        design(NetworkedAgents(chain(2), STATIC), LocalKalman)
    with pytest.raises(ArgumentError, match=r"one of LocalKalman, .*; got 'local-kalman'; write LocalKalman\(\)"):
        design(NetworkedAgents(chain(2), STATIC), "local-kalman")


def test_the_list_of_methods_is_complete_and_labelled() -> None:
    assert set(METHODS) == set(Method.__subclasses__())
    labels = [method.label for method in METHODS]
    assert labels[0] == "local-kalman"
    assert len(set(labels)) == len(labels)


# -- the problem -------------------------------------------------------------------------------------------------------
def test_a_bare_graph_is_no_problem() -> None:
    refused(
        chain(3), LocalKalman(), "a NetworkedAgents problem", "got MeasurementGraph", "NetworkedAgents(graph, agent)"
    )


def test_different_agents_are_refused() -> None:
    each = [LinearAgent(-1.0, 1.0), LinearAgent(-2.0, 1.0)]
    refused(NetworkedAgents(chain(2), each), LocalKalman(), "equal agents", "different A or C", "one agent")


@pytest.mark.parametrize(
    "agent",
    [
        LinearAgent([[0, 1], [0, 0]], [[0, 1]]),
        LinearAgent(np.diag([1.0, -1.0]), [[0, 1]]),
        LinearAgent([[0, 1], [-1, 0]], [[0, 0]]),
        LinearAgent([[0, 1, 0], [0, 0, 1], [0, 0, 0]], [[0, 1, 0]]),
    ],
    ids=["position unseen", "unstable mode unseen", "rotation unseen", "inside a Jordan block"],
)
def test_undetectable_agents_are_refused(agent) -> None:
    refused(NetworkedAgents(chain(2), agent), LocalKalman(), "detectable", "Assumption 2", "Measure something")


def test_agents_that_rounding_decides_are_refused_with_their_distance() -> None:
    agent = LinearAgent(np.diag([1.0, -1.0]), [[3e-11, 1.0]])
    refused(NetworkedAgents(chain(2), agent), LocalKalman(), "within", "of not detectable at s = 1")


def test_an_unseen_stable_mode_is_no_obstacle() -> None:
    agent = LinearAgent(np.diag([1.0, -1.0]), [[1.0, 0.0]])
    assert design(NetworkedAgents(chain(3), agent), LocalKalman()).spectral_abscissa < 0


@pytest.mark.parametrize("rule", [FromGraph(), WorstCase(4), Fixed(3.0), Family([chain(4)])])
def test_drifting_agents_without_an_anchor_are_refused_by_name(rule) -> None:
    graph = MeasurementGraph(4, [-1, 2], [1, 3], names=["a", "b", "c", "d"])
    for agent in (STATIC, DOUBLE_INTEGRATOR):
        refused(
            NetworkedAgents(graph, agent),
            LocalKalman(rule),
            "path from every node to an external arc",
            "Theorem 3",
            "no such path from a, c, d.",
            "Add an absolute reading",
        )


def test_a_rotation_counts_as_undamped_however_its_eigenvalues_round() -> None:
    """The computed real parts of an oscillator may be -1e-17: rounding is no damping."""
    rng = np.random.default_rng(0)
    rotation = np.array([[0.0, 1.0], [-1.0, 0.0]])
    signs = set()
    for _ in range(20):
        T = rng.normal(size=(2, 2))
        A = T @ rotation @ np.linalg.inv(T)
        signs.add(bool(np.linalg.eigvals(A).real.max() < 0))
        refused(NetworkedAgents(cycle(3), LinearAgent(A, [[1, 0]])), LocalKalman(Fixed(1.0)), "Theorem 3")
    assert signs == {True, False}, "both kinds of rounding were drawn"


def test_long_lists_of_nodes_are_cut() -> None:
    refused(NetworkedAgents(cycle(11), STATIC), LocalKalman(Fixed(1.0)), "0, 1, 2, 3, 4, 5, 6, 7 and 3 more")
    refused(NetworkedAgents(cycle(11), FALLING), LocalKalman(), "0, 1, 2, 3, 4, 5, 6, 7 and 3 more", "Fixed(gamma)")


# -- the gain rules ----------------------------------------------------------------------------------------------------
def test_from_graph_needs_an_anchor_even_for_stable_agents() -> None:
    refused(NetworkedAgents(cycle(3), FALLING), LocalKalman(), "lambda_min > 0", "0, 1, 2", "WorstCase(max_nodes)")


def test_from_graph_needs_a_positive_lower_bound() -> None:
    bound = replace(smallest_eigenvalue(chain(3)), lower=0.0)
    with pytest.raises(MethodError, match=r"got lambda_min >= 0\. Add an anchor"):
        FromGraph().choose(chain(3), bound)


def test_worst_case_refuses_larger_graphs() -> None:
    refused(NetworkedAgents(chain(5), STATIC), LocalKalman(WorstCase(4)), "max_nodes = 4", "5 nodes", "Raise max_nodes")


@pytest.mark.parametrize(
    "weight", [[1.0, 0.999, 2.0], np.array([np.eye(2), [[1.5, 1.0], [1.0, 1.5]], np.eye(2)])], ids=["scalar", "block"]
)
def test_worst_case_refuses_weights_below_one(weight) -> None:
    """E-000-14."""
    agent = STATIC if np.ndim(weight) == 1 else LinearAgent.static(2)
    graph = chain(3).with_weight(weight)
    refused(NetworkedAgents(graph, agent), LocalKalman(WorstCase(4)), "at least 1", "a weight of 0.", "FromGraph()")


def test_a_family_names_the_graph_without_an_anchor() -> None:
    rule = Family([chain(3), cycle(3)])
    refused(NetworkedAgents(chain(3), STATIC), LocalKalman(rule), "every graph externally connected", "graph 1 is not")
    refused(
        NetworkedAgents(cycle(3), FALLING), LocalKalman(Family([chain(3)])), "FromGraph", "no such path from 0, 1, 2"
    )


@pytest.mark.parametrize("margin", [1.0, 0.5, -2.0, np.nan, np.inf])
def test_margins_must_exceed_one(margin) -> None:
    for make in (FromGraph, lambda m: WorstCase(4, m), lambda m: Family([chain(2)], m)):
        with pytest.raises(ArgumentError, match="margin must be above 1"):
            make(margin)


@pytest.mark.parametrize("gamma", [0.0, -1.0, np.nan, np.inf])
def test_a_given_gain_must_be_positive(gamma) -> None:
    with pytest.raises(ArgumentError, match="gamma must be a positive number; got"):
        Fixed(gamma)


@pytest.mark.parametrize("size", [0, -3, 2.5, True])
def test_worst_case_needs_a_number_of_nodes(size) -> None:
    with pytest.raises(ArgumentError, match="n_nodes must be a whole number of at least 1"):
        WorstCase(size)


def test_a_family_needs_a_graph() -> None:
    with pytest.raises(ArgumentError, match="at least one graph"):
        Family([])


# -- covariances and P -------------------------------------------------------------------------------------------------
@pytest.mark.parametrize(
    ("arguments", "requirement"),
    [
        ({"measurement": [[0.0]]}, "measurement symmetric positive definite of shape (1, 1)"),
        ({"measurement": np.eye(2)}, "measurement symmetric positive definite of shape (1, 1)"),
        ({"process": np.diag([1.0, -1.0])}, "process symmetric positive semidefinite of shape (2, 2)"),
        ({"process": [[1.0, 0.5], [0.0, 1.0]]}, "process symmetric positive semidefinite of shape (2, 2)"),
        ({"process": np.eye(3)}, "process symmetric positive semidefinite of shape (2, 2)"),
        ({"P": np.diag([1.0, 0.0])}, "P symmetric positive definite of shape (2, 2)"),
    ],
)
def test_covariances_must_be_covariances(arguments, requirement) -> None:
    refused(NetworkedAgents(chain(2), DOUBLE_INTEGRATOR), LocalKalman(**arguments), requirement, "Check the units")


def test_covariances_must_be_finite_matrices() -> None:
    with pytest.raises(ArgumentError, match="process must be finite; got nan"):
        LocalKalman(process=[[np.nan]])
    with pytest.raises(ShapeError, match="measurement must be a matrix"):
        LocalKalman(measurement=[1.0, 2.0])
    with pytest.raises(ArgumentError, match="P must be an array of real numbers"):
        LocalKalman(P="identity")


def test_a_given_matrix_must_satisfy_8() -> None:
    problem = NetworkedAgents(chain(2), DOUBLE_INTEGRATOR)
    refused(problem, LocalKalman(P=np.eye(2)), "A' P + P A - 2 C' R^-1 C < 0", "largest eigenvalue is", "Leave P out")


def test_noise_must_reach_every_undamped_mode() -> None:
    problem = NetworkedAgents(chain(2), DOUBLE_INTEGRATOR)
    refused(
        problem, LocalKalman(process=np.diag([1.0, 0.0])), "noise that reaches every mode", "positive definite process"
    )


def test_weight_blocks_and_a_measurement_covariance_exclude_each_other() -> None:
    graph = chain(2).with_weight(np.broadcast_to(np.eye(2), (2, 2, 2)))
    method = LocalKalman(measurement=np.eye(2))
    refused(
        NetworkedAgents(graph, LinearAgent.static(2)), method, "either weight blocks", "both", "leave measurement out"
    )
