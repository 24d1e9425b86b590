"""Textbook levelling networks, typed in from the publications named in each file, with their published answers."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from trigpoint.estimation import estimate
from trigpoint.io import load

FOLDER = Path(__file__).parent / "data"

PUBLISHED = {
    "ghilani_12_6": (
        0.6511843,
        3,
        {"B": (448.108712, 0.00229534), "C": (453.468468, 0.00263628), "D": (444.943605, 0.00176069)},
    ),
    "niemeier": (
        3.3941763,
        4,
        {
            "1": (68.923468, 0.00312206),
            "2": (60.715254, 0.00259614),
            "3": (63.193765, 0.00196804),
            "4": (56.283822, 0.00262573),
            "5": (44.322554, 0.00230205),
        },
    ),
    "krumm": (
        0.9438798,
        1,
        {
            "1": (93.456, 0.00578006),
            "2": (107.754136, 0.00672712),
            "3": (103.453545, 0.00668939),
            "4": (100.462, 0.00746203),
        },
    ),
    "mikhail_7_4": (
        6.3583349,
        4,
        {
            "B": (825.220624, 0.180514),
            "C": (835.53543, 0.161455),
            "D": (809.533928, 0.200965),
            "E": (830.846029, 0.171073),
        },
    ),
    "baumann": (
        0.4424066,
        11,
        {
            "1": (199.289235, 0.000740707),
            "2": (199.912933, 0.000503496),
            "3": (207.64255, 0.000526127),
            "5": (218.376526, 0.00033392),
            "7": (212.900967, 0.000265872),
            "10": (210.882574, 0.000348787),
            "11": (211.377328, 0.000310629),
            "12": (204.40838, 0.000402453),
            "13": (199.886696, 0.000285177),
        },
    ),
}
"""Network: (m0, degrees of freedom, {point: (adjusted height, standard deviation)}); Krumm (2020) prints them."""

PRINTED = {
    "ghilani_12_6": {"B": (448.1087, 0.0023), "C": (453.4685, 0.0026), "D": (444.9436, 0.0018)},
}
"""As rounded in the book itself."""


@pytest.mark.parametrize("name", sorted(PUBLISHED))
def test_heights_and_deviations_are_the_published_ones(name) -> None:
    m0, freedom, points = PUBLISHED[name]
    network = load(FOLDER / f"{name}.csv")
    found = estimate(network)
    at = {point: network.graph.index(point) for point in points}
    assert found.degrees_of_freedom == freedom
    assert np.sqrt(found.variance_factor) == pytest.approx(m0, rel=1e-6)
    for point, (height, sigma) in points.items():
        assert found.x[at[point]] == pytest.approx(height, abs=1.5e-6)
        assert found.sigma[at[point]] == pytest.approx(sigma, rel=5e-6)
    assert found.sigma_kind == "a-posteriori"
    assert set(found.status.tolist()) == {"anchored"}
    assert found.redundancy.sum() == pytest.approx(freedom, abs=1e-9)


@pytest.mark.parametrize("name", sorted(PRINTED))
def test_the_printed_digits_are_met(name) -> None:
    network = load(FOLDER / f"{name}.csv")
    found = estimate(network)
    for point, (height, sigma) in PRINTED[name].items():
        k = network.graph.index(point)
        assert round(float(found.x[k]), 4) == height
        assert round(float(found.sigma[k]), 4) == sigma


def test_every_file_has_an_answer() -> None:
    assert {path.stem for path in FOLDER.glob("*.csv")} == set(PUBLISHED)
