"""What a network refuses, since it would be wrong later."""

import numpy as np
import pytest
import scipy.sparse as sp

from trigpoint.arrays import encode_array
from trigpoint.errors import ArgumentError, ShapeError
from trigpoint.graphs import EXTERNAL, MeasurementGraph, chain
from trigpoint.model import Network


def test_weight_blocks_fit_the_measured_numbers():
    graph = chain(2).with_weight(np.broadcast_to(np.eye(3), (2, 3, 3)))
    with pytest.raises(ShapeError, match="weight blocks are 3 x 3, but a measurement has 1 numbers"):
        Network(graph, [0.0, 1.0])


def test_a_correlated_reading_of_a_known_node_is_not_dropped_silently():
    graph = MeasurementGraph(2, [0, EXTERNAL, EXTERNAL], [1, 0, 0])
    joint = sp.csr_array(np.array([[1.0, 0.0, 0.5], [0.0, 0.0, 0.0], [0.5, 0.0, 1.0]]))
    network = Network(graph, [1.0, 5.0, 5.1], joint, exact=[False, True, False])
    with pytest.raises(ArgumentError, match="correlated with other arcs"):
        network.with_exact_readings_as_marks()


@pytest.mark.parametrize("array", [np.array([1j]), np.array([2**63], dtype=np.uint64), np.array(["a"])])
def test_only_numbers_that_fit_are_written(array):
    if array.dtype == np.uint64:
        assert encode_array(array)["type"] == "f8"
    else:
        with pytest.raises(ArgumentError, match="only real and whole numbers"):
            encode_array(array)
