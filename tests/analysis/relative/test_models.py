"""The two problems: shapes, sparsity, refusals."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse as sp

from trigpoint.errors import ArgumentError, ShapeError
from trigpoint.graphs import EXTERNAL, MeasurementGraph, chain, cycle
from trigpoint.model.agreement import AgreementDynamics
from trigpoint.model.relative_sensing import RelativeSensing


def test_the_output_has_a_row_for_every_arc() -> None:
    problem = RelativeSensing(np.eye(3), cycle(3, anchors=(2,)), B=np.ones((3, 1)))
    C = problem.output()
    assert sp.issparse(C)
    np.testing.assert_array_equal(C.toarray(), [[-1, 1, 0], [0, -1, 1], [1, 0, -1], [0, 0, 1]])
    assert problem.n_states == 3
    assert problem.B.shape == (3, 1)
    assert repr(problem) == "RelativeSensing(3 states, dense A, 4 measurements)"


@pytest.mark.parametrize("kind", [sp.csr_array, sp.csc_matrix, sp.coo_array])
def test_a_sparse_matrix_stays_sparse_and_a_copy(kind) -> None:
    A = kind(np.diag([1.0, 2.0]))
    problem = RelativeSensing(A, chain(2))
    assert problem.is_sparse
    A.data[0] = 7.0
    assert problem.A.toarray()[0, 0] == 1.0
    assert not problem.A.data.flags.writeable
    assert "sparse A" in repr(problem)


@pytest.mark.parametrize(
    ("A", "B", "error", "message"),
    [
        (np.eye(2), None, ShapeError, r"A must be square .* shape \(3, 3\); got shape \(2, 2\)"),
        (sp.eye_array(2), None, ShapeError, r"A must be square .* shape \(3, 3\); got shape \(2, 2\)"),
        (np.ones((3, 2)), None, ShapeError, r"A must be square .* shape \(3, 3\); got shape \(3, 2\)"),
        (np.eye(3), np.ones((2, 1)), ShapeError, r"B must have one row a state of A \(3, 3\); got shape \(2, 1\)"),
        (np.diag([1.0, np.nan, 0.0]), None, ArgumentError, r"A must be finite; got nan at position \(1, 1\)"),
        (sp.csr_array(np.diag([1.0, 1.0, np.inf])), None, ArgumentError, r"A must be finite; got inf at .*\(2, 2\)"),
        (np.eye(3), [[np.nan], [0], [0]], ArgumentError, "B must be finite; got nan"),
        (sp.eye_array(3, dtype=complex), None, ArgumentError, "A must be an array of real numbers; got a sparse"),
    ],
)
def test_wrong_matrices_are_refused(A, B, error, message) -> None:
    with pytest.raises(error, match=message):
        RelativeSensing(A, cycle(3), B)


def test_agreement_takes_the_internal_arcs_only() -> None:
    graph = MeasurementGraph(3, [0, EXTERNAL, 1], [1, 2, 2], [2.0, 9.0, 3.0])
    problem = AgreementDynamics(graph, [2, 0, 2])
    np.testing.assert_array_equal(problem.dynamics().toarray(), [[-2, 2, 0], [2, -5, 3], [0, 3, -3]])
    np.testing.assert_array_equal(problem.output().toarray(), [[1, 0, 0], [0, 0, 1]])
    assert problem.measured.tolist() == [0, 2]
    assert not problem.measured.flags.writeable
    assert repr(problem) == "AgreementDynamics(3 nodes, 2 measured)"
    assert AgreementDynamics(graph, 1).measured.tolist() == [1]


def test_wrong_agreement_problems_are_refused() -> None:
    with pytest.raises(ArgumentError, match="measured must list at least one node; got none"):
        AgreementDynamics(chain(3), [])
    with pytest.raises(ArgumentError, match=r"measured\[1\] = 3 is no index"):
        AgreementDynamics(chain(3), [0, 3])
    with pytest.raises(ArgumentError, match=r"measured\[0\] = -1 is no index"):
        AgreementDynamics(chain(3), [-1])
    with pytest.raises(ShapeError, match="the graph's weight blocks are 2 x 2"):
        AgreementDynamics(MeasurementGraph(2, [0], [1], [np.eye(2)]), [0])
