"""What ``Heterogeneous`` refuses: each message names the requirement, what was got and the remedy."""

from __future__ import annotations

import sys

import numpy as np
import pytest

import trigpoint as tp
from trigpoint.errors import ArgumentError, MethodError, MissingExtraError
from trigpoint.graphs import MeasurementGraph, chain
from trigpoint.methods.heterogeneous import Heterogeneous
from trigpoint.model import HyperNetwork, LinearAgent, NetworkedAgents

from .drawn_heterogeneous import TWO, ring_without_anchor


def refused(problem, method, *words: str) -> None:
    with pytest.raises(MethodError) as caught:
        method.build(problem)
    text = str(caught.value)
    assert caught.value.method == "Heterogeneous"
    for word in words:
        assert word in text, text


# -- choices -----------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize(
    ("choice", "words"),
    [
        ({"rate": -1.0}, "rate must be a number of at least 0"),
        ({"rate": np.nan}, "rate must be a number of at least 0"),
        ({"gamma": 0.0}, "gamma must be a positive number or None"),
        ({"gamma": np.inf}, "gamma must be a positive number or None"),
        ({"only": "magic"}, "only must be None or one of marginal, inequality, abscissa, dynamic; got 'magic'"),
        ({"only": "stable"}, "only must be None or one of"),
        ({"starts": 0}, "starts must be at least 1"),
    ],
)
def test_choices_that_make_no_sense(choice, words) -> None:
    with pytest.raises(ArgumentError, match=words):
        Heterogeneous(**choice)


# -- problems ----------------------------------------------------------------------------------------------------------
def test_other_kinds_of_problem() -> None:
    plant = tp.SharedPlant(np.eye(2), [np.eye(2)], {0: []})
    for problem in (plant, chain(3)):
        refused(problem, Heterogeneous(), "a HyperNetwork or NetworkedAgents problem", type(problem).__name__)


def test_networks_too_large_for_a_dense_design() -> None:
    agents = NetworkedAgents(chain(4001), LinearAgent.static())
    refused(agents, Heterogeneous(), "at most 4000 states", "got 4001", "LocalKalman()")


def test_an_undetectable_network_is_refused_by_the_names_of_its_nodes() -> None:
    equal = HyperNetwork([[[0.3]], [[0.3]], [[0.7]]], [{0: [[1.0]], 1: [[1.0]]}, {2: [[1.0]]}], ["ann", "bob", "eve"])
    refused(equal, Heterogeneous(), "a detectable network (G16, Theorem 2)", "nodes ann, bob", "s = 0.3", "Measure one")


def test_a_wanted_rate_needs_slow_modes_to_be_seen_too() -> None:
    network = HyperNetwork([[[-0.5]], [[0.2]]], [{1: [[1.0]]}], ["slow", "fast"])
    assert Heterogeneous().build(network).decay_rate > 0.0
    refused(network, Heterogeneous(rate=1.0), "modes of A + 1 I", "node slow", "s = 0.5")


def test_what_rounding_decides_is_refused() -> None:
    network = HyperNetwork([[[1.0]], [[1.0 + 1e-11]]], [{0: [[1.0]], 1: [[1.0]]}], ["a", "b"])
    refused(network, Heterogeneous(), "a detectable network", "nodes a, b", "rounding decides", "Rescale")


# -- steps -------------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize(
    ("only", "words"), [("marginal", "not all unstable modes"), ("inequality", "no block-diagonal P, proved by Z")]
)
def test_a_step_that_cannot_serve_alone(only, words) -> None:
    verdict = "no unstable decentralized fixed mode, so that some decentralized stabiliser exists"
    refused(TWO, Heterogeneous(only=only), f"nodes slow, fast with only step '{only}'", words, verdict, "Allow all")


def test_a_gain_that_rounding_swallows() -> None:
    refused(
        ring_without_anchor(), Heterogeneous(gamma=1e-300, only="marginal"), "rounding leaves the computed abscissa"
    )


def test_one_part_with_many_states_is_marginal_or_refused() -> None:
    agents = [LinearAgent(0.1 + 0.01 * k, 1.0) for k in range(201)]
    problem = NetworkedAgents(MeasurementGraph(201, np.arange(200), np.arange(1, 201)), agents)
    refused(
        problem, Heterogeneous(), "0, 1, 2, 3, 4, 5, 6, 7 and 193 more", "inequality left out", "steps 4 and 5 left"
    )


# -- the extra ---------------------------------------------------------------------------------------------------------
def test_without_the_engine_the_inequality_is_left_out(monkeypatch) -> None:
    monkeypatch.setitem(sys.modules, "clarabel", None)
    observer = Heterogeneous().build(TWO)
    assert observer.facts["step"] == "abscissa"
    assert any("the extra 'lmi' is not installed" in note for note in observer.facts["notes"])
    assert "Z" not in observer.facts
    assert observer.decay_rate > 0.0
    assert Heterogeneous().build(ring_without_anchor()).facts["step"] == "marginal"


def test_the_inequality_alone_needs_the_engine(monkeypatch) -> None:
    monkeypatch.setitem(sys.modules, "clarabel", None)
    with pytest.raises(MissingExtraError, match=r"'clarabel', which is not installed: pip install 'trigpoint\[lmi\]'"):
        Heterogeneous(only="inequality").build(TWO)
