"""Numbers known from elsewhere, which the experiments must find."""

from __future__ import annotations

import numpy as np
import pytest

import trigpoint as tp
from tests.papers.runs import at, result_of
from trigpoint.papers import g16_moving, g16_table1, r23_symmetry, reproduce

CENSUS = {
    2: (2, 0, 0, 0),
    3: (6, 4, 4, 0),
    4: (24, 18, 18, 0),
    5: (105, 79, 79, 0),
    6: (672, 530, 502, 28),
    7: (5971, 4179, 3941, 238),
}
"""By size: anchored pairs, unobservable ones, symmetric ones, unobservable ones without a symmetry (E-001-9)."""

COMPLETE = {1: 8.887, 2: 4.386, 3: 2.884}
"""1/lambda_min of eight agents that all hear one another, by the number of anchors (theory 3.3)."""


def test_the_frames_of_the_altitudes_leave_what_theory_says() -> None:
    result = result_of("g16-altitude")
    left = [at(result, f"error left at {frame} s, mean over 4000 draws") for frame in ("0.01", "0.07", "0.48", "2")]
    np.testing.assert_allclose(left, [0.864, 0.478, 0.207, 0.140], atol=4e-3)
    assert at(result, "smallest eigenvalue") == pytest.approx(0.0358034, abs=5e-8)
    assert at(result, "what is left of the slowest mode after 2 s") == pytest.approx(0.699, abs=5e-4)


def test_theorem_5_guards_a_covariance_of_half_its_bound() -> None:
    result = result_of("g16-theorem5")
    assert at(result, "N J_1") == pytest.approx(4 * 4 * np.sqrt(2.0), rel=1e-9)
    assert 12.0 < at(result, "mu = 0.66, lower end: E[e'e]") < 13.3
    assert 12.0 < at(result, "mu = 0.66, upper end: E[e'e]") < 13.3


def test_the_second_worst_tree_is_apart() -> None:
    assert at(result_of("g16-trees"), "second smallest, N = 8") == pytest.approx(0.034836, abs=5e-7)


@pytest.mark.parametrize("anchors", COMPLETE)
def test_eight_agents_in_reach_of_one_another(anchors: int) -> None:
    small = g16_moving.World(8, 1.2, 0.8, (0.5, 1.0), True, 1.0, 0)  # the diagonal is shorter than the reach
    values = np.linalg.eigvalsh(small.topology(anchors).graph_at(small.graph(anchors), 0.5).laplacian().toarray())
    assert 1.0 / values[0] == pytest.approx(COMPLETE[anchors], abs=5e-4)


def test_the_side_of_the_square_decides_whether_15_is_exceeded() -> None:
    result = result_of("g16-moving")
    worst = [
        at(result, f"side {side}, 1 anchor, 3 draws: largest 1/lambda_min while connected") for side in (1, 1.5, 2)
    ]
    assert worst[0] < worst[1] < 15.0 < worst[2]
    shares = [at(result, f"side {side}, 1 anchor, 3 draws: share of the time connected") for side in (1, 2, 3)]
    assert shares[0] == 1.0
    assert shares[2] < 0.5 < 0.85 < shares[1] < 1.0


def test_anchors_within_reach_only_leave_agents_alone_more_often() -> None:
    place = "1 anchor, gain 15: share of the time connected"
    assert at(reproduce("g16-moving", persistent=False), place) < at(result_of("g16-moving"), place)


def test_the_bounds_of_cut_off_networks_are_infinite() -> None:
    np.testing.assert_array_equal(g16_moving.bounds(np.array([0.5, 1e-15, 0.0])), [2.0, np.inf, np.inf])


@pytest.mark.parametrize("n", [2, 3, 4, 5, 6, pytest.param(7, marks=pytest.mark.slow)])
def test_the_census_of_anchored_graphs(n: int) -> None:
    pairs, unobservable, symmetric, without, against = r23_symmetry.count(n)
    assert (pairs, unobservable, symmetric, without) == CENSUS[n]
    assert against == 0


def test_the_census_and_diagnose_agree() -> None:
    for graph in (tp.graphs.chain(5, anchors=()), tp.graphs.cycle(5), tp.graphs.star(5, anchors=())):
        L = graph.laplacian().toarray()
        for node in range(5):
            seen = tp.diagnose(tp.AgreementDynamics(graph, [node])).observable
            assert r23_symmetry.blind(L, node) is (seen is False)


def test_the_rates_of_the_rings() -> None:
    result = result_of("r23-tracking")
    rates = [at(result, f"ring of {n}, w = {w}: rate of the observer") for n in (5, 10) for w in (1, 100)]
    np.testing.assert_allclose(rates, [0.3765, 13.92, 0.0971, 5.219], rtol=6e-4)
    assert at(result, "amplitude") == pytest.approx(1.97279, abs=5e-6)
    assert at(result, "lag") == pytest.approx(9.462, abs=5e-4)


def test_the_image_needs_minutes_as_predicted() -> None:
    result = result_of("r23-image")
    assert at(result, "slowest rate, 1/s") == pytest.approx(0.029197394550, abs=2e-11)
    assert at(result, "time to 1 % that no start exceeds, s") == pytest.approx(157.7, abs=0.05)
    predicted = np.log(100.0 * at(result, "share of the slow mode in the first error")) / 0.029197394550
    assert at(result, "time to 1 %, measured, s") == pytest.approx(predicted, rel=0.01)
    assert 0.0 < at(result, "error left at the end (220 s), share") < 0.01
    assert at(result, "error estimate of the run, share") < 1e-6
    assert [field.title for field in result.fields][:3] == ["truth", "0 s", "0.01 s"]
    assert all(field.values.shape == (70, 128) for field in result.fields)


def test_table_1_does_not_depend_on_the_number_of_workers() -> None:
    options = {"samples": 40, "sizes": (30,), "shares": (20, 50)}
    one, two = (reproduce("g16-table1", workers=workers, **options) for workers in (1, 2))
    assert one == two


def test_table_1_tells_sizes_that_the_paper_does_not_have() -> None:
    result = reproduce("g16-table1", samples=20, sizes=(20,), shares=(50,))
    assert [entry.verdict for entry in result.cells] == ["not specified"]


def test_the_closed_form_of_table_1_is_the_mean_of_the_drawn_statistic() -> None:
    found = g16_table1.index(30, 0.5, 4000, np.random.SeedSequence(5))
    assert found.sampled == pytest.approx(found.demeaned, abs=4.0 * found.spread / np.sqrt(4000))
    assert found.spread == pytest.approx(0.0215, abs=0.002)


@pytest.mark.slow
def test_table_1_in_full() -> None:
    result = reproduce("g16-table1")
    assert result.agrees
    assert len(result.cells) == 4 + 3 * 60
    assert at(result, "entries within three standard errors") == 58
    assert at(result, "entries within two standard errors") >= 55
    misprints = {"N = 80, p = 60", "N = 70, p = 100"}
    wrong = {entry.at for entry in result.cells if entry.verdict == "erratum" and entry.at.startswith("J, ")}
    assert wrong == {f"J, {place}" for place in misprints}
    assert at(result, "literal index over the printed one, least") > 2.6
    assert at(result, "literal index over the printed one, greatest") < 3.7
