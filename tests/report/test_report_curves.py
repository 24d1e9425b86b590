"""Curves and grey pictures: well-formed, self-contained, deterministic SVG, and an error for every misuse."""

from __future__ import annotations

import re
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest

from trigpoint.errors import ArgumentError, ShapeError
from trigpoint.report import Figure, curves_figure, pictures_figure

SVG = "{http://www.w3.org/2000/svg}"
X = np.linspace(0.0, 2.0, 30)
CURVES: dict[str, tuple[dict[str, Any], dict[str, Any]]] = {
    "one": ({"a": X}, {}),
    "logarithmic": ({"a": np.exp(-X), "b": np.exp(-2.0 * X)}, {"log_y": True, "y_label": "error [m]"}),
    "a gap": ({"a": np.where(X > 1.0, np.nan, X)}, {}),
    "nothing positive": ({"a": -X, "b": 0.0 * X}, {"log_y": True}),
    "constant": ({"a": 0.0 * X + 3.0}, {"log_y": True}),
    "many": ({f"agent {k}": X + k for k in range(12)}, {"title": "Agents"}),
    "hostile": ({"<script>$x^2": X, "a & b": X, "_hidden": X}, {"title": "<b>&", "x_label": "$t", "y_label": "\x00"}),
}


def checked(svg: str) -> ElementTree.Element:
    Figure(svg, "")  # what a page demands
    root = ElementTree.fromstring(svg)
    assert set(re.findall(r'https?://[^"\s<]*', svg)) <= {"http://www.w3.org/2000/svg", "http://www.w3.org/1999/xlink"}
    return root


def texts(svg: str) -> list[str]:
    return ["".join(element.itertext()) for element in checked(svg).iter(SVG + "text")]


@pytest.mark.parametrize("case", CURVES)
def test_curves_are_self_contained_and_deterministic(case: str) -> None:
    lines, options = CURVES[case]
    svg = curves_figure(X, lines, **options)
    checked(svg)
    assert svg == curves_figure(X, lines, **options)


def test_curves_say_what_they_show() -> None:
    found = texts(curves_figure(X, {"one": X, "two": 2.0 * X}, x_label="time [s]", y_label="error [m]", title="Both"))
    assert {"one", "two", "time [s]", "error [m]", "Both"} <= set(found)
    assert "one" not in texts(curves_figure(X, {"one": X}))


def test_pictures_say_what_they_show() -> None:
    tables = [(f"frame {k}", np.full((3, 5), 0.2 * k)) for k in range(5)]
    svg = pictures_figure(tables, title="Frames")
    assert {name for name, _ in tables} <= set(texts(svg))
    assert svg == pictures_figure(tables, title="Frames")
    assert svg.count("<image") == 5
    assert 'aria-label="Frames"' in svg


@pytest.mark.parametrize(
    ("arguments", "error", "words"),
    [
        ((X, {}), ArgumentError, "a curve over at least two places"),
        (([1.0], {"a": [1.0]}), ArgumentError, "at least two places"),
        ((X, {"a": X[1:]}), ShapeError, "curve 'a' has shape"),
    ],
)
def test_curves_misuse(arguments: tuple[Any, Any], error: type[Exception], words: str) -> None:
    with pytest.raises(error, match=words):
        curves_figure(*arguments)


@pytest.mark.parametrize(
    ("pictures", "options", "error", "words"),
    [
        ([], {}, ArgumentError, "expected a picture"),
        ([("a", np.zeros((2, 2)))], {"low": 1.0, "high": 1.0}, ArgumentError, "low < high"),
        ([("a", np.zeros(3))], {}, ShapeError, "picture 'a' has shape"),
        ([("a", np.zeros((2, 2))), ("b", np.zeros((2, 3)))], {}, ShapeError, "picture 'b'"),
    ],
)
def test_pictures_misuse(pictures: Any, options: dict[str, float], error: type[Exception], words: str) -> None:
    with pytest.raises(error, match=words):
        pictures_figure(pictures, **options)
