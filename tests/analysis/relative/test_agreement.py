"""Agreement dynamics: the census of all small graphs, chains, symmetries, structure beyond numerics."""

from __future__ import annotations

import functools
import itertools
import math

import networkx as nx
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from trigpoint.analysis import symmetry
from trigpoint.analysis.agreement import MeasurementNode, diagnose_agreement, measurement_nodes
from trigpoint.analysis.blind_spots import blind_spot, spectrum_of
from trigpoint.analysis.pairs import pair_margin
from trigpoint.analysis.symmetry import find_symmetry
from trigpoint.errors import ArgumentError, ShapeError
from trigpoint.graphs import EXTERNAL, MeasurementGraph, chain, complete, cycle, grid, random_connected, star
from trigpoint.model.agreement import AgreementDynamics
from trigpoint.testing.strategies import measurement_graphs

PATH_WITHOUT_SYMMETRY = MeasurementGraph(6, [0, 0, 2, 3, 4], [1, 5, 3, 4, 5])
CENSUS = {2: (2, 0, 0, 0), 3: (6, 4, 4, 0), 4: (24, 18, 18, 0), 5: (105, 79, 79, 0), 6: (672, 530, 502, 28)}


def diagnose(graph, measured):
    return diagnose_agreement(AgreementDynamics(graph, measured))


def check_findings(graph, measured, found) -> None:
    """Every direction moves without the measured nodes noticing, forever."""
    problem = AgreementDynamics(graph, measured)
    L, E = problem.laplacian().toarray(), problem.output().toarray()
    for finding in found.findings:
        vector = np.zeros(graph.n_nodes)
        vector[list(finding.nodes)] = finding.direction[:, 0]
        assert np.linalg.norm(vector) == pytest.approx(1.0)
        size = np.linalg.norm(L, 2) or 1.0
        rows = [E]
        for _ in range(graph.n_nodes):
            rows.append(rows[-1] @ L / size)
        assert np.abs(np.vstack(rows) @ vector).max() < 1e-9
        assert finding.remedy.endswith(".")


@functools.lru_cache(maxsize=1)
def atlas() -> tuple[nx.Graph, ...]:
    return tuple(g for g in nx.graph_atlas_g() if g.number_of_nodes() > 1 and nx.is_connected(g))


def census(n) -> tuple[int, int, int, int]:
    """Pairs of graph and measured node; unobservable; symmetric; unobservable without symmetry."""
    pairs = unobservable = symmetric = odd = 0
    for drawn in atlas():
        if drawn.number_of_nodes() != n:
            continue
        graph = MeasurementGraph.from_networkx(drawn)
        spectrum = spectrum_of(AgreementDynamics(graph, [0]).laplacian())
        for node in range(n):
            verdict = blind_spot(spectrum, np.array([node])).verdict
            assert verdict is not None
            mirrored = find_symmetry(graph, [node]) is not None
            assert not (mirrored and verdict)
            pairs, unobservable, symmetric = pairs + 1, unobservable + (not verdict), symmetric + mirrored
            odd += not verdict and not mirrored
    return pairs, unobservable, symmetric, odd


@pytest.mark.parametrize("n", [2, 3, 4, 5, 6])
def test_the_census_of_all_connected_graphs(n) -> None:
    assert census(n) == CENSUS[n]


@pytest.mark.slow
def test_the_census_of_seven_nodes() -> None:
    assert census(7) == (5971, 4179, 3941, 238)


@pytest.mark.parametrize("n", [2, 3, 4, 5])
def test_the_diagnosis_agrees_with_the_census(n) -> None:
    unobservable = 0
    for drawn in atlas():
        if drawn.number_of_nodes() == n:
            graph = MeasurementGraph.from_networkx(drawn)
            for node in range(n):
                found = diagnose(graph, [node])
                assert found.detectable is True
                unobservable += found.observable is False
                check_findings(graph, [node], found)
    assert unobservable == CENSUS[n][1]


def test_the_smallest_network_unobservable_without_symmetry() -> None:
    found = diagnose(PATH_WITHOUT_SYMMETRY, [0])
    assert found.observable is False
    assert found.theorem == "R23, Lemma 17"
    (finding,) = found.findings
    assert finding.kind == "unseen-mode"
    assert "s = -1 " in finding.text
    assert "no symmetry" in finding.text
    assert "instead (alone it shows every mode)" in finding.remedy
    assert find_symmetry(PATH_WITHOUT_SYMMETRY, [0]) is None
    check_findings(PATH_WITHOUT_SYMMETRY, [0], found)


@pytest.mark.parametrize("n", [20, 50, 100, 1000, 10_000])
def test_a_chain_measured_at_its_end_is_observable(n) -> None:
    for end in (0, n - 1):
        found = diagnose(chain(n), [end])
        assert (found.observable, found.detectable, found.findings) == (True, True, ())
        assert math.isnan(found.margin) == (n > 2000)
        assert found.theorem == ("zero forcing, R23, Lemma 17" if n > 2000 else "R23, Lemma 17")


@pytest.mark.parametrize("n", [3, 21, 501, 10_001])
def test_an_odd_chain_measured_at_its_centre_names_the_mirror(n) -> None:
    found = diagnose(chain(n), [n // 2])
    assert (found.observable, found.detectable) == (False, True)
    assert found.theorem == "R23, Theorem 21"
    (finding,) = found.findings
    assert finding.kind == "symmetry"
    assert finding.text.startswith(f"mirror symmetry exchanging 0 and {n - 1}")
    if n <= 501:
        check_findings(chain(n), [n // 2], found)
    else:
        assert (finding.nodes, found.margin) == ((0, n - 1), 0.0)


def test_figure_one_of_the_paper() -> None:
    """R23, Figure 1: of the path of three only the middle is observation symmetric; here every node of a triangle."""
    assert [diagnose(chain(3), [node]).observable for node in range(3)] == [True, False, True]
    for graph in (complete(3), complete(4), cycle(5)):
        for node in range(graph.n_nodes):
            found = diagnose(graph, [node])
            assert found.observable is False
            assert {finding.kind for finding in found.findings} == {"symmetry", "repeated-mode"}
            check_findings(graph, [node], found)


def test_a_repeated_mode_needs_as_many_nodes() -> None:
    found = diagnose(star(6), [1, 2])
    finding = next(finding for finding in found.findings if finding.kind == "repeated-mode")
    assert "the mode s = -1 is 4-fold, so 4 nodes must be measured at least; 2 are." in finding.text
    check_findings(star(6), [1, 2], found)
    assert diagnose(star(6), [1, 2, 3, 4]).observable is True
    many = diagnose(star(40), [0])
    assert many.findings[0].remedy == "Measure more nodes: at least 38."


def test_symmetric_weights_that_no_mirror_shows() -> None:
    turning = nx.frucht_graph()  # no symmetry at all
    graph = MeasurementGraph.from_networkx(turning)
    assert find_symmetry(graph) is None
    rotor = MeasurementGraph(
        7, [0, 1, 2, 0, 1, 2, 3, 4, 5], [3, 4, 5, 4, 5, 3, 6, 6, 6], [1.0] * 3 + [2.0] * 3 + [5.0] * 3
    )
    found = diagnose(rotor, [6])
    assert found.observable is False
    check_findings(rotor, [6], found)


def test_a_component_without_measured_node() -> None:
    graph = MeasurementGraph(5, [0, 2, 3, EXTERNAL], [1, 3, 4, 2])
    found = diagnose(graph, [4])
    assert (found.observable, found.detectable, found.margin) == (False, False, 0.0)
    (finding,) = found.findings
    assert finding.kind == "unmeasured"
    assert finding.nodes == (0, 1)
    check_findings(graph, [4], found)
    assert diagnose(graph, [4, 0]).observable is True
    assert diagnose(MeasurementGraph(1, [], []), [0]).margin == 1.0


def test_findings_of_a_component_carry_the_indices_of_the_whole() -> None:
    graph = MeasurementGraph(6, [1, 3, 0], [3, 5, 2])  # the chain 1-3-5 measured in its middle
    found = diagnose(graph, [0, 3, 4])
    (finding,) = found.findings
    assert finding.nodes == (1, 5)
    assert "exchanging 1 and 5" in finding.text
    check_findings(graph, [0, 3, 4], found)


@settings(max_examples=30)
@given(measurement_graphs(max_nodes=6, weighted=True, decades=0), st.data())
def test_the_verdict_agrees_with_the_general_pair(graph, data) -> None:
    measured = data.draw(st.lists(st.integers(0, graph.n_nodes - 1), min_size=1, max_size=3))
    problem = AgreementDynamics(graph, measured)
    L = problem.laplacian().toarray()
    found = diagnose_agreement(problem)
    expected = pair_margin(-L / (np.linalg.norm(L, 2) or 1.0), problem.output().toarray()).verdict
    assert found.observable is expected
    check_findings(graph, measured, found)


@pytest.mark.parametrize("seed", range(8))
def test_the_margin_is_the_smallest_singular_value_over_real_shifts(seed) -> None:
    rng = np.random.default_rng(seed)
    graph = random_connected(int(rng.integers(3, 14)), 0.3, rng)
    graph = graph.with_weight(rng.uniform(0.5, 2, size=graph.n_arcs))
    problem = AgreementDynamics(graph, rng.integers(graph.n_nodes, size=2))
    L = problem.laplacian().toarray()
    L, E = L / np.linalg.norm(L, 2), problem.output().toarray()
    shifts = -np.linspace(0, 1, 4001)
    grid_minimum = min(np.linalg.svd(np.vstack([s * np.eye(len(L)) + L, E]), compute_uv=False)[-1] for s in shifts)
    assert diagnose_agreement(problem).margin == pytest.approx(grid_minimum, rel=0.02)


def test_weights_in_any_unit() -> None:
    for unit in (1e-12, 1e12):
        graph = chain(5).with_weight(np.full(5, unit))
        assert diagnose(graph, [0]).observable is True
        assert diagnose(graph, [2]).observable is False


def test_structure_decides_where_rounding_would() -> None:
    weak = chain(6).with_weight([1.0, 1e-9, 1e-3, 1.0, 1e-9, 1.0])
    found = diagnose(weak, [0])
    assert found.observable is True
    (finding,) = found.findings
    assert finding.kind == "weakly-observable"
    assert found.theorem.startswith("zero forcing")
    nearly = MeasurementGraph(3, [0, 1], [1, 2], [1.0, 1.0 + 1e-11])
    found = diagnose(nearly, [1])
    assert found.observable is None
    assert found.findings[0].kind == "undecided"
    assert diagnose(nearly.with_weight([1.0, 1.0]), [1]).observable is False


def test_beyond_two_thousand_nodes_structure_alone_decides(monkeypatch) -> None:
    found = diagnose(chain(2001), [500])
    assert (found.observable, found.detectable) == (None, True)
    assert "not decided beyond 2000 nodes" in found.findings[0].text
    monkeypatch.setattr(symmetry.importlib, "import_module", missing)
    found = diagnose(cycle(2001), [0])
    assert found.observable is None
    assert "symmetries were not searched for" in found.findings[0].text
    assert "trigpoint[symmetry]" in found.findings[0].remedy


def missing(name):
    raise ImportError(name)


def test_a_grid_measured_in_its_corner() -> None:
    found = diagnose(grid(10, 10), [0])
    assert found.observable is False
    assert found.findings[0].text.startswith("mirror symmetry exchanging 1 and 10, 2 and 20")
    check_findings(grid(10, 10), [0], found)


def test_measurement_nodes_are_ranked() -> None:
    nodes = measurement_nodes(PATH_WITHOUT_SYMMETRY)
    assert [entry.node for entry in nodes] == [1, 2, 4, 5]
    margins = [entry.margin for entry in nodes]
    assert all(a >= b * (1 - 1e-9) for a, b in itertools.pairwise(margins))
    assert measurement_nodes(chain(1)) == (MeasurementNode(0, 1.0),)
    assert measurement_nodes(complete(4)) == ()
    assert measurement_nodes(MeasurementGraph(2, [], [])) == ()


@settings(max_examples=30)
@given(measurement_graphs(max_nodes=6))
def test_measurement_nodes_are_those_that_diagnose_accepts(graph) -> None:
    accepted = {node for node in range(graph.n_nodes) if diagnose(graph, [node]).observable}
    assert {entry.node for entry in measurement_nodes(graph)} == accepted


def test_the_remedy_works() -> None:
    for graph, node in ((chain(9), 4), (grid(3, 4), 0), (cycle(8), 0)):
        remedy = diagnose(graph, [node]).findings[0].remedy
        listed = remedy.split("measure node")[-1].split("Measure node")[-1]
        added = [int(word) for word in listed.replace(",", " ").split() if word.isdigit()]
        assert diagnose(graph, [node, *added]).observable is True


def test_wrong_arguments_are_refused() -> None:
    with pytest.raises(ArgumentError, match="measurement_nodes takes up to 2000 nodes; got 2001"):
        measurement_nodes(chain(2001))
    with pytest.raises(ShapeError, match="needs scalar arc weights"):
        measurement_nodes(MeasurementGraph(2, [0], [1], [np.eye(2)]))
