"""Figures: well-formed, self-contained, deterministic SVG, and an error for every misuse."""

import re
import subprocess
import sys
from xml.etree import ElementTree

import numpy as np
import pytest

from trigpoint import graphs
from trigpoint.errors import ArgumentError, MissingExtraError, ShapeError
from trigpoint.graphs import EXTERNAL, MeasurementGraph
from trigpoint.report import error_figure, network_figure, node_positions

SVG = "{http://www.w3.org/2000/svg}"
HOSTILE = ("<script>alert(1)</script>", "$x^2", "a & b", "\x00\x0b", "\ud800", "測点", "‮")


def checked(svg):
    root = ElementTree.fromstring(svg)
    assert root.tag == SVG + "svg"
    assert root.get("role") == "img"
    assert root.get("aria-label")
    assert "<!DOCTYPE" not in svg
    assert "<metadata" not in svg
    assert set(re.findall(r'https?://[^"\s<]*', svg)) <= {"http://www.w3.org/2000/svg", "http://www.w3.org/1999/xlink"}
    for element in root.iter():
        for name, value in element.attrib.items():
            if name.endswith("href"):
                assert value.startswith(("#", "data:image/png"))
    identifiers = [element.get("id") for element in root.iter() if element.get("id")]
    assert len(set(identifiers)) == len(identifiers)
    return root


def texts(svg):
    return ["".join(element.itertext()) for element in checked(svg).iter(SVG + "text")]


CASES = {
    "one node": (MeasurementGraph(1, [EXTERNAL], [0]), {}),
    "no arcs": (MeasurementGraph(3, [], []), {}),
    "chain": (graphs.chain(6, anchors=(5,)), {}),
    "two islands": (MeasurementGraph(5, [0, 1, 3], [1, 2, 4]), {}),
    "star": (graphs.star(12), {"node_values": np.arange(12.0)}),
    "parallel": (MeasurementGraph(2, [0, 0, 1], [1, 1, 0]), {"positions": [[0, 0], [1, 0]]}),
    "all known": (graphs.cycle(3), {"known": [0, 1, 2], "node_values": [0.0, 0.0, 0.0]}),
    "no values": (graphs.cycle(3), {"node_values": [np.nan] * 3}),
    "equal values": (graphs.cycle(3), {"node_values": [2.0, 2.0, np.inf], "label": "sigma"}),
    "three dimensions": (graphs.cycle(3), {"positions": [[0, 0, 5], [1, 0, 5], [0, 2, 7]]}),
    "one place": (graphs.cycle(3), {"positions": np.zeros((3, 2))}),
    "upright": (graphs.chain(3), {"positions": [[0, 0], [0, 1], [0, 2]]}),
}


@pytest.mark.parametrize("case", CASES)
def test_network_figures_are_self_contained_and_deterministic(case):
    graph, options = CASES[case]
    svg = network_figure(graph, **options)
    checked(svg)
    assert network_figure(graph, **options) == svg


def test_hostile_names_and_labels_are_text():
    graph = MeasurementGraph(len(HOSTILE), [0, 1], [1, 2], names=HOSTILE)
    svg = network_figure(graph, node_values=np.arange(7.0), label=HOSTILE[0], title="<b>$y_1$")
    shown = texts(svg)
    assert "<script>" not in svg
    assert {"<script>alert(1)</script>", "$x^2", "a & b", "測点", "<b>$y_1$"} <= {text.strip() for text in shown}


def test_names_stand_beside_at_most_sixty_nodes():
    assert "0" in texts(network_figure(graphs.chain(60)))
    assert texts(network_figure(graphs.chain(61))) == ["external arc"]


def test_legend_names_only_what_is_drawn():
    graph = MeasurementGraph(3, [0, 1], [1, 2])
    assert "external arc" not in texts(network_figure(graph))
    both = texts(network_figure(graph, node_values=[1.0, np.nan, 2.0], known=[2], label="sigma [mm]"))
    assert {"no value", "known mark", "sigma [mm]"} <= set(both)


def test_thousands_of_nodes_are_drawn():
    root = checked(network_figure(graphs.grid(50, 50), node_values=np.arange(2500.0)))
    assert len(list(root.iter(SVG + "use"))) >= 2500
    image = checked(network_figure(graphs.grid(80, 80)))
    assert list(image.iter(SVG + "image"))


def test_inputs_are_not_mutated_and_user_settings_neither_read_nor_changed():
    import matplotlib

    values, positions = np.array([1.0, np.inf, 3.0]), np.eye(3)[:, :2].copy()
    plain = network_figure(graphs.cycle(3), positions, values)
    with matplotlib.rc_context({"font.size": 30.0, "svg.fonttype": "path"}):
        assert network_figure(graphs.cycle(3), positions, values) == plain
        assert matplotlib.rcParams["font.size"] == 30.0
    np.testing.assert_array_equal(values, [1.0, np.inf, 3.0])
    np.testing.assert_array_equal(positions, np.eye(3)[:, :2])


@pytest.mark.parametrize(
    ("options", "error", "text"),
    [
        ({"positions": np.zeros((2, 2))}, ShapeError, r"positions must have shape \(3, 2\)"),
        ({"positions": np.zeros((3, 1))}, ShapeError, "positions must have shape"),
        ({"positions": [[0, 0], [1, np.nan], [0, 1]]}, ArgumentError, "positions must be finite"),
        ({"node_values": [1.0]}, ShapeError, r"node_values must have shape \(3,\)"),
        ({"known": [3]}, ArgumentError, "known"),
    ],
)
def test_network_misuse(options, error, text):
    with pytest.raises(error, match=text):
        network_figure(graphs.cycle(3), **options)


@pytest.mark.parametrize("graph", [graphs.chain(7), graphs.grid(4, 5), graphs.star(9), graphs.grid(15, 15)])
def test_layout_keeps_nodes_apart_and_neighbours_near(graph):
    places = node_positions(graph)
    np.testing.assert_array_equal(places, node_positions(graph))
    gaps = np.linalg.norm(places[:, None] - places, axis=2)
    assert gaps[np.triu_indices(graph.n_nodes, 1)].min() > 0.2
    inner = ~graph.is_external
    lengths = gaps[graph.tail[inner], graph.head[inner]]
    assert np.median(lengths) == pytest.approx(1.0)
    assert lengths.max() < 3.0


@pytest.mark.parametrize(("rows", "columns"), [(3, 3), (4, 4), (6, 9), (15, 15)])
def test_a_grid_is_a_square_and_no_diamond(rows, columns):
    graph = graphs.grid(rows, columns)
    places = node_positions(graph)
    inner = ~graph.is_external
    ways = places[graph.head[inner]] - places[graph.tail[inner]]
    along = np.abs(ways).max(axis=1) / np.linalg.norm(ways, axis=1)
    assert np.median(along) > np.cos(np.deg2rad(15.0))
    middle = 0.5 * (places.min(axis=0) + places.max(axis=0))
    assert places[0, 0] < middle[0]
    assert places[0, 1] > middle[1]
    width, height = np.ptp(places, axis=0)
    assert width >= 0.99 * height


def test_components_do_not_overlap():
    places = node_positions(MeasurementGraph(9, [0, 1, 3, 4], [1, 2, 4, 5]))
    gaps = np.linalg.norm(places[:, None] - places, axis=2)
    assert gaps[:3, 3:].min() > 0.5
    assert gaps[np.triu_indices(9, 1)].min() > 0.5


ERRORS = {
    "falling": ([0, 1, 2], [4, 2, 1], {"rate": 0.5, "unit": "m", "marks": [(1.0, 2.0, "half")]}),
    "early mark": (np.arange(100), np.exp(-0.1 * np.arange(100)), {"marks": [(1.0, 0.9, "<here> $x")]}),
    "constant": ([0, 1], [2, 2], {"rate": 0.0}),
    "zeros inside": ([0, 1, 2], [0, 2, 0], {"rate": 1.0}),
    "zero": ([0, 1], [0, 0], {"rate": 1.0}),
    "one sample": ([3], [2], {}),
    "steep": ([0, 1e3], [1e300, 1e-300], {"rate": 1e6}),
    "growing": ([0, 1e3], [1.0, 2.0], {"rate": -1e6}),
    "tiny": ([0, 1], [5e-324, 5e-324], {}),
}


@pytest.mark.parametrize("case", ERRORS)
def test_error_figures_are_self_contained_and_deterministic(case):
    times, norm, options = ERRORS[case]
    svg = error_figure(times, norm, **options)
    checked(svg)
    assert error_figure(times, norm, **options) == svg


def test_error_figure_says_what_it_shows():
    shown = texts(error_figure([0, 1], [2, 1], rate=0.69, rate_label="$a <b>", unit="m/s", marks=[(1, 1, "mark")]))
    assert {"error norm [m/s]", "time [s]", "$a <b>, 0.69 1/s", "mark"} <= set(shown)
    assert "the error is zero at every sample" in texts(error_figure([0], [0]))


@pytest.mark.parametrize(
    ("arguments", "error", "text"),
    [
        (([0, 1], [1]), ShapeError, "equal length"),
        (([[0]], [[1]]), ShapeError, "must be vectors"),
        (([], []), ArgumentError, "at least one sample"),
        (([0, 1], [1, -1]), ArgumentError, r"error_norm\[1\] = -1.0 is negative"),
        (([0, 1], [1, np.nan]), ArgumentError, "must be finite"),
        (([0], [1], [1, 2]), ArgumentError, "rate must be one number"),
        (([0], [1], np.inf), ArgumentError, "rate must be finite"),
        (([0], [1], None, "", "", [(0.0, 0.0, "zero")]), ArgumentError, "mark 'zero'"),
        (([0], [1], None, "", "", [(np.nan, 1.0, "when")]), ArgumentError, "mark 'when'"),
    ],
)
def test_error_misuse(arguments, error, text):
    with pytest.raises(error, match=text):
        error_figure(*arguments)


def test_importing_the_package_loads_no_engine():
    code = "import sys, trigpoint.report; print([m for m in ('matplotlib', 'jinja2') if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_missing_matplotlib_is_named_at_use(monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    with pytest.raises(MissingExtraError, match=r"'matplotlib'.*trigpoint\[report\]"):
        network_figure(graphs.chain(2))
    with pytest.raises(MissingExtraError, match="matplotlib"):
        error_figure([0], [1])
