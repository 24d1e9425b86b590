"""Agents: sizes, views and refusals."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings

from trigpoint.errors import ArgumentError, ShapeError
from trigpoint.model import LinearAgent
from trigpoint.testing.strategies import agents


@settings(max_examples=30)
@given(agents(inputs=True))
def test_sizes_follow_the_matrices(agent) -> None:
    assert agent.A.shape == (agent.n_states, agent.n_states)
    assert agent.C.shape == (agent.n_outputs, agent.n_states)
    assert agent.B.shape == (agent.n_states, agent.n_inputs)
    assert agent.E.shape[0] == agent.n_states
    assert agent.is_static == (not agent.A.any())
    assert f"{agent.n_states} states" in repr(agent)


def test_the_static_agent_is_an_unknown_constant() -> None:
    agent = LinearAgent.static(3)
    assert agent.is_static
    assert np.array_equal(agent.C, np.eye(3))
    assert (agent.n_inputs, agent.B, agent.E) == (0, None, None)


def test_scalars_are_one_by_one_and_inputs_are_copied() -> None:
    A = np.eye(2)
    agent = LinearAgent(A, np.eye(2))
    A[0, 0] = 5.0
    assert agent.A[0, 0] == 1.0
    assert not agent.A.flags.writeable
    assert LinearAgent(-1.0, 2.0).C.shape == (1, 1)


@pytest.mark.parametrize(
    ("arguments", "kind", "words"),
    [
        ((np.zeros((2, 3)), np.eye(2)), ShapeError, r"A must be square with at least one row; got shape \(2, 3\)"),
        ((np.zeros((0, 0)), np.zeros((1, 0))), ShapeError, "A must be square with at least one row"),
        ((np.eye(2), np.eye(3)), ShapeError, r"C must have one column a state of A \(2, 2\).*got shape \(3, 3\)"),
        ((np.eye(2), np.zeros((0, 2))), ShapeError, "at least one row"),
        ((np.eye(2), [1.0, 0.0]), ShapeError, "C must be a matrix"),
        ((np.eye(2), np.eye(2), np.eye(3)), ShapeError, r"B must have one row a state of A \(2, 2\)"),
        ((np.eye(2), np.eye(2), None, np.eye(3)), ShapeError, "E must have one row a state"),
        ((np.eye(2) * np.nan, np.eye(2)), ArgumentError, "A must be finite"),
        ((np.eye(2), np.eye(2), [[np.inf], [0.0]]), ArgumentError, "B must be finite"),
        (("A", np.eye(2)), ArgumentError, "A must be an array of real numbers"),
    ],
)
def test_every_refusal_says_what_is_wrong(arguments, kind, words) -> None:
    with pytest.raises(kind, match=words):
        LinearAgent(*arguments)


def test_a_static_agent_of_no_dimension_is_refused() -> None:
    with pytest.raises(ShapeError, match="at least one row"):
        LinearAgent.static(0)
