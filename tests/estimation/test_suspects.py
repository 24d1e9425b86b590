"""Suspects with few degrees of freedom, where the residuals' own scale could hide them."""

import numpy as np
import pytest

from trigpoint.estimation import estimate
from trigpoint.graphs import cycle
from trigpoint.model import Network


def _ring_with_error(gross: float, parallel: int) -> Network:
    graph = cycle(3, anchors=(0,))
    rows = [*np.tile(np.arange(3), parallel).tolist(), 3]
    tail, head = graph.tail[rows], graph.head[rows]
    truth = np.array([0.0, 1.0, 3.0])
    values = np.where(tail < 0, truth[head], truth[head] - truth[tail])
    noise = 1e-3 * np.random.default_rng(5).standard_normal(len(rows))
    values = values + noise
    values[1] += gross
    many = type(graph)(3, tail, head)
    return Network(many, values, np.full(len(rows), 1e-6))


def test_a_gross_error_is_found_with_seven_degrees_of_freedom():
    answer = estimate(_ring_with_error(0.5, parallel=3))
    assert answer.degrees_of_freedom == 7
    assert np.abs(answer.standardized).max() < 3.29  # the a-posteriori scale is blown up by the error itself
    assert answer.suspects[0] == 1


def test_clean_data_has_no_suspect():
    assert estimate(_ring_with_error(0.0, parallel=3)).suspects == ()


@pytest.mark.parametrize("a_priori", [True, False])
def test_one_degree_of_freedom_cannot_point_at_a_measurement_by_its_own_scale(a_priori):
    answer = estimate(_ring_with_error(0.5, parallel=1), a_priori=a_priori)
    assert answer.degrees_of_freedom == 1
    assert bool(answer.suspects) == a_priori
