"""Real networks with published answers (read from the reference data folder)."""

from __future__ import annotations

import json

import numpy as np
import pytest

from trigpoint.estimation import estimate
from trigpoint.graphs import EXTERNAL, MeasurementGraph
from trigpoint.io import load
from trigpoint.linalg.blocks import diagonal_of
from trigpoint.model import Network

TEXTBOOKS = [
    "Baumann_Height_fix",
    "Ghilani12_6_Height_fix",
    "Krumm_Height_fix",
    "Niemeier_Height_fix1",
    "mikhail-7.4",
    "mikhail-7.4-cov",
    "stroner-levelling-a",
]


def document(folder, name):
    return json.loads((folder / "json" / f"{name}.json").read_text(encoding="utf-8"))


def levelling(data) -> Network:
    """Height differences, and the fixed heights as exact readings."""
    names, fixed = data["nodes"], data["fixed"]
    at = {name: k for k, name in enumerate(names)}
    edges = data["edges"]
    graph = MeasurementGraph(
        len(names),
        [at[e["from"]] for e in edges] + [EXTERNAL] * len(fixed),
        [at[e["to"]] for e in edges] + [at[name] for name in fixed],
        names=names,
    )
    values = [e["z"][0] for e in edges] + [height[0] for height in fixed.values()]
    variances = [e["cov"][0][0] for e in edges] + [1.0] * len(fixed)
    exact = np.arange(len(values)) >= len(edges)
    return Network(graph, values, variances, exact=exact, known=[at[name] for name in fixed])


def assert_published(data, network: Network, height: float, deviation: float) -> None:
    meta = data["expected_meta"]
    found = estimate(network, a_priori=meta["sigma_used"] == "apriori")
    for name, point in data["expected"].items():
        k = network.graph.index(name)
        assert found.x[k] == pytest.approx(point["x"][0], abs=height), name
        assert found.sigma[k] == pytest.approx(point["sd"][0], rel=deviation), name
    assert found.gradient <= 1e-13
    assert found.redundancy.sum() == pytest.approx(found.degrees_of_freedom, abs=1e-9)
    if "dof" in meta:
        assert found.degrees_of_freedom == meta["dof"]
        ratio = meta["sigma0_aposteriori"] / meta["sigma0_apriori"]
        assert np.sqrt(found.variance_factor) == pytest.approx(ratio, rel=1e-7)
    for k, name in enumerate(data.get("expected_cov_ids", ())):
        variance = found.sigma[network.graph.index(name)] ** 2
        assert variance == pytest.approx(data["expected_cov"][k][k], rel=1e-6)


@pytest.mark.parametrize("name", TEXTBOOKS)
def test_levelling_networks_have_their_published_heights(shared_data, name) -> None:
    data = document(shared_data, f"levelling_{name}")
    assert_published(data, levelling(data), 1e-9, 1e-6)


@pytest.mark.parametrize("name", TEXTBOOKS)
def test_their_survey_files_say_the_same(shared_data, name) -> None:
    data = document(shared_data, f"levelling_{name}")
    network = load(shared_data / "gkf" / f"{name}.gkf")
    assert_published(data, network, 1e-9, 1e-6)
    assert {network.graph.names[k] for k in network.known} == set(data["fixed"])


@pytest.mark.parametrize("name", TEXTBOOKS)
def test_known_marks_may_be_eliminated_first(shared_data, name) -> None:
    """The network of the estimating nodes only: same heights, same deviations."""
    network = levelling(document(shared_data, f"levelling_{name}"))
    part = network.without_known_marks()
    whole, reduced = estimate(network), estimate(part.network)
    np.testing.assert_allclose(reduced.x, whole.x[part.nodes], rtol=0, atol=1e-9)
    between = set(range(network.graph.n_arcs)) - set(part.arcs.tolist()) - set(np.flatnonzero(network.exact).tolist())
    if not between:
        np.testing.assert_allclose(reduced.sigma, whole.sigma[part.nodes], rtol=1e-9)


def test_the_danish_national_levelling(shared_data) -> None:
    """Four separate networks, one bench mark each: 3.1e-7 m and 2.3e-4 relative (their digits)."""
    data = document(shared_data, "levelling_fire_dk")
    network = levelling(data)
    assert len(network.graph.components) == 4
    assert network.graph.is_externally_connected
    assert_published(data, network, 5e-7, 5e-4)
    assert estimate(network).degrees_of_freedom == 99


def test_gnss_baselines_with_a_correlated_cluster(shared_data) -> None:
    """Printed to 0.1 mm: coordinates 1.1e-4 m; deviations (east, north, up) compared through their sum of squares."""
    data = document(shared_data, "gnss_dynadjust")
    at = {name: k for k, name in enumerate(data["nodes"])}
    tail, head, values, blocks = [], [], [], []
    for group in data["groups"]:
        tail += [at[a] for a, _ in group["edges"]]
        head += [at[b] for _, b in group["edges"]]
        values += group["z"]
        blocks.append(np.array(group["cov"]))
    for prior in data["priors"]:
        tail += [EXTERNAL] * len(prior["ids"])
        head += [at[name] for name in prior["ids"]]
        values += prior["z"]
        blocks.append(np.array(prior["cov"]))
    joint = diagonal_of(0.5 * (block + block.T) for block in blocks)
    graph = MeasurementGraph(len(at), tail, head, names=data["nodes"])
    found = estimate(Network(graph, np.reshape(values, (-1, 3)), joint), a_priori=True)
    meta = data["expected_meta"]
    assert found.degrees_of_freedom == meta["dof"] == 288
    square_sum = found.variance_factor * found.degrees_of_freedom
    assert square_sum == pytest.approx(336.76, abs=0.005), "expected_meta's own figure; the publication prints 336.64"
    assert square_sum == pytest.approx(meta["chi2"], abs=0.13)
    assert found.variance_factor == pytest.approx(meta["sigma_zero"], abs=1e-3)
    for name, point in data["expected"].items():
        assert np.abs(found.x[at[name]] - point["x"]).max() <= 1.15e-4, name
        size = np.linalg.norm(found.sigma[at[name]])
        assert size == pytest.approx(np.linalg.norm(point["sd_enu"]), abs=np.sqrt(3) * 5e-5), name
    assert found.gradient <= 1e-13


def free_energies(data, anchors) -> Network:
    at = {name: k for k, name in enumerate(data["nodes"])}
    edges = data["edges"]
    graph = MeasurementGraph(
        len(at),
        [at[e["from"]] for e in edges] + [EXTERNAL] * len(anchors),
        [at[e["to"]] for e in edges] + [at[name] for name in anchors],
        names=data["nodes"],
    )
    readings = [data["experimental"][name] for name in anchors]
    values = [e["z"][0] for e in edges] + [value for value, _ in readings]
    return Network(graph, values, [e["cov"][0][0] for e in edges] + [deviation**2 for _, deviation in readings])


def test_free_energies_up_to_their_mean(shared_data) -> None:
    data = document(shared_data, "freeenergy_cinnabar")
    found = estimate(free_energies(data, []), a_priori=True)
    expected = np.array([data["expected_free"][name] for name in data["nodes"]])
    np.testing.assert_allclose(found.x - found.x.mean(), expected - expected.mean(), atol=1e-9)
    assert set(found.status.tolist()) == {"relative"}


def test_free_energies_with_three_soft_anchors(shared_data) -> None:
    data = document(shared_data, "freeenergy_cinnabar")
    found = estimate(free_energies(data, data["anchors3"]), a_priori=True)
    expected = [data["expected_3_soft_anchors"][name] for name in data["nodes"]]
    np.testing.assert_allclose(found.x, [point["x"] for point in expected], atol=1e-9)
    np.testing.assert_allclose(found.sigma, [point["sd"] for point in expected], rtol=1e-9)
