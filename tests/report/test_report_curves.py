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
    "not finite": ({"a": np.where(X > 1.0, np.inf, 1e300)}, {"log_y": True}),
    "events": ({"a": X}, {"events": [0.5, 1.0]}),
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


def test_one_place_nothing_known_and_events_are_drawn() -> None:
    assert "nothing is known" in texts(curves_figure([0.0], {"x": [np.nan]}, y_label="y"))
    checked(curves_figure([0.0], {"x": [1.0]}))
    plain, marked = curves_figure(X, {"a": X}), curves_figure(X, {"a": X}, events=[0.5, 1.5])
    assert marked.count("<path") == plain.count("<path") + 2


def test_curves_that_coincide_are_told_apart() -> None:
    """The one below is whole and wide, those above are broken and thinner, so that it is seen in their gaps."""
    lines = {"below": X, "above": X, "third": X}
    strokes = re.findall(r"stroke-(?:dasharray: [0-9., ]+|width: [0-9.]+)", curves_figure(X, lines))
    widths = [float(stroke.split(": ")[1]) for stroke in strokes if "width" in stroke]
    assert max(widths) == 2.6
    assert len({stroke for stroke in strokes if "dasharray" in stroke}) >= 2
    few = curves_figure(X[:5], {name: values[:5] for name, values in lines.items()})
    assert len(re.findall(r"<defs>\s*<path", few)) > len(re.findall(r"<defs>\s*<path", curves_figure(X, lines)))


@pytest.mark.parametrize(("low", "high"), [(0.45, 0.81), (2.0, 3.0), (0.3, 12.0), (1e-5, 0.1)])
def test_logarithmic_axes_have_the_numbers_that_people_write(low: float, high: float) -> None:
    """Below two decades plain numbers, never 6 x 10^-1; powers of ten above."""
    svg = curves_figure(X, {"a": np.geomspace(low, high, X.shape[0])}, log_y=True, x_label="", y_label="")
    labels = texts(svg)
    assert not any("\N{MULTIPLICATION SIGN}" in label for label in labels)
    if high < 100.0 * low:
        shown = [float(label) for label in labels if re.fullmatch(r"[0-9.]+", label)]
        assert sum(low <= one <= high for one in shown) >= 2


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
        ((X, {}), ArgumentError, "a curve over at least one place"),
        (([], {"a": []}), ArgumentError, "at least one place"),
        (([[0.0]], {"a": [[0.0]]}), ArgumentError, "at least one place"),
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
