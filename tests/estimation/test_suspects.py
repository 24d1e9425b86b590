"""Suspects with few degrees of freedom, where the residuals' own scale could hide them."""

import numpy as np
import pytest
from scipy import stats

from trigpoint.errors import ArgumentError
from trigpoint.estimation import GlobalTest, estimate
from trigpoint.graphs import chain, complete, cycle
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


def test_one_degree_of_freedom_cannot_point_at_a_measurement_by_its_own_scale():
    network = _ring_with_error(0.5, parallel=1)
    unstated = estimate(network.graph, network.values)
    assert (unstated.degrees_of_freedom, unstated.global_test, unstated.suspects) == (1, None, ())
    assert unstated.suspects_kind == "a-posteriori"
    for a_priori in (True, False):
        found = estimate(network, a_priori=a_priori)
        assert found.suspects, "the stated sigmas tell that the ring does not close"
        assert found.suspects_kind == "a-priori"


# -- the global test ---------------------------------------------------------------------------------------------------
@pytest.mark.parametrize(
    ("quantile", "freedom", "upper"),
    [(3.841, 1, 0.05), (16.266, 3, 0.001), (18.307, 10, 0.05), (29.588, 10, 0.001), (124.342, 100, 0.05)],
)
def test_the_global_test_has_the_tabulated_quantiles(quantile, freedom, upper):
    """Upper quantiles of chi-square as in every printed table."""
    test = GlobalTest.of(quantile, freedom, 0.001)
    assert test.p_value == pytest.approx(2 * upper, rel=2e-3)
    assert test.passes


def test_a_blunder_fails_the_global_test_and_the_stated_sigmas_rank_it():
    network = _ring_with_error(0.02, parallel=2)
    found, prior = estimate(network), estimate(network, a_priori=True)
    assert found.global_test == prior.global_test
    assert found.global_test.statistic == pytest.approx(4 * found.variance_factor)
    assert not found.global_test.passes
    assert found.suspects == prior.suspects
    assert found.suspects[0] == 1
    np.testing.assert_allclose(found.suspect_scores, np.abs(prior.standardized[list(prior.suspects)]), rtol=1e-12)
    np.testing.assert_allclose(found.standardized * np.sqrt(found.variance_factor), prior.standardized, rtol=1e-12)
    assert found.sigma_kind == "a-posteriori"
    assert "does not fit the stated sigmas (4 degrees of freedom, p" in found.summary()
    assert found.summary().endswith("a blunder, or sigmas too small")


def test_sigmas_far_too_large_fail_on_the_other_side_and_scale_nothing():
    clean = _ring_with_error(0.0, parallel=3)
    wide = estimate(Network(clean.graph, clean.values, np.ones(clean.graph.n_arcs)))
    assert not wide.global_test.passes
    assert not wide.global_test.too_large
    assert wide.global_test.text.endswith("sigmas too large")
    assert (wide.suspects_kind, wide.suspects) == ("a-posteriori", ())
    single = _ring_with_error(0.0, parallel=1)
    assert "(1 degree of freedom, p" in estimate(single).global_test.text


def test_the_level_is_the_share_of_false_alarms():
    graph = complete(5, anchors=(0,))
    rng = np.random.default_rng(11)
    variances = rng.uniform(0.5, 2.0, size=graph.n_arcs)
    p = np.array(
        [
            estimate(graph, np.sqrt(variances) * rng.normal(size=graph.n_arcs), variances, uncertainty=False)
            .global_test.p_value
            for _ in range(400)
        ]
    )  # fmt: skip
    assert stats.kstest(p, "uniform").pvalue > 0.01
    values = np.sqrt(variances) * rng.normal(size=graph.n_arcs)
    loose = estimate(graph, values, variances, level=0.5)
    assert loose.global_test.level == 0.5
    assert loose.global_test.passes == (loose.global_test.p_value >= 0.5)


def test_nothing_redundant_has_no_global_test_and_a_hopeless_one_says_so():
    assert estimate(chain(3), [1.0, 1.0, 1.0], [1.0, 1.0, 1.0]).global_test is None
    assert "p below 1e-300" in GlobalTest.of(1e6, 3, 0.001).text


@pytest.mark.parametrize("level", [0.0, 1.0, -0.1, np.nan])
def test_a_level_is_a_probability(level):
    with pytest.raises(ArgumentError, match="level must be a probability between 0 and 1"):
        estimate(chain(2), [1.0, 2.0], level=level)
