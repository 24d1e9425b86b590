"""GNU Gama height networks: published files, every message with its line, and round trips."""

from __future__ import annotations

import json

import numpy as np
import pytest
import scipy.sparse as sp
from hypothesis import HealthCheck, assume, given, settings

from tests.io.drawn import XML_TEXT, assert_same, dense, networks
from trigpoint.errors import ArgumentError, FileFormatError
from trigpoint.graphs import EXTERNAL, MeasurementGraph
from trigpoint.io import gama_text, load, parse_gama, save
from trigpoint.model import Network

NAMES = ["Baumann_Height_fix", "Ghilani12_6_Height_fix", "Krumm_Height_fix", "Niemeier_Height_fix1", "mikhail-7.4"]
NAMES += ["mikhail-7.4-cov", "stroner-levelling-a"]


@pytest.mark.parametrize("name", NAMES)
def test_a_published_file_equals_its_json_counterpart(shared_data, name):
    network = load(shared_data / "gkf" / f"{name}.gkf")
    expected = json.loads((shared_data / "json" / f"levelling_{name}.json").read_text(encoding="utf-8"))
    names, graph = network.graph.names, network.graph
    count = len(expected["edges"])
    assert sorted(names) == sorted(expected["nodes"])
    assert [names[k] for k in graph.tail[:count]] == [edge["from"] for edge in expected["edges"]]
    assert [names[k] for k in graph.head[:count]] == [edge["to"] for edge in expected["edges"]]
    np.testing.assert_array_equal(network.values[:count], [edge["z"][0] for edge in expected["edges"]])
    np.testing.assert_allclose(
        network.covariance[:count], [edge["cov"][0][0] for edge in expected["edges"]], rtol=1e-14
    )
    assert {names[k]: value.tolist() for k, value in network.known_values().items()} == expected["fixed"]
    assert network.exact.tolist() == [False] * count + [True] * len(expected["fixed"])
    assert network.unit == "m"
    assert_same(parse_gama(gama_text(network).encode()), network)


POINTS = '<point id="A" x="1" y="2" z="100" fix="z"/>\n<point id="B" adj="Z"/>\n<point id="C" adj="xyz"/>\n'


def gkf(inside, points=POINTS, axes=""):
    return (
        f'<?xml version="1.0"?>\n<gama-local>\n<network{axes}>\n<description> A\ntitle </description>\n'
        f"<points-observations>\n{points}{inside}\n</points-observations>\n</network>\n</gama-local>\n"
    )


def cluster(inside):
    return gkf(f"<height-differences>\n{inside}\n</height-differences>")


DH = '<dh from="A" to="B" val=" 1.5 " stdev="2"/>'
FIRST = 11  # line of the first element inside a cluster


def test_a_small_file_is_read_in_metres():
    text = cluster(DH + '\n<dh from=" B " to="C" val="2" dist="4"/>').replace("\n", "\r\n")
    network = parse_gama(b"\xef\xbb\xbf" + text.encode())
    assert network.graph.names == ("A", "B", "C")
    assert network.graph.tail.tolist() == [0, 1, EXTERNAL]
    assert network.values.tolist() == [1.5, 2.0, 100.0]
    np.testing.assert_allclose(network.covariance, [4e-6, 4e-4, 0.0], rtol=1e-15)
    assert network.known == (0,)
    assert network.title == "A\ntitle"
    np.testing.assert_array_equal(network.positions, [[2, 1], [np.nan] * 2, [np.nan] * 2])


@pytest.mark.parametrize(("axes", "place"), [("en", [1, 2]), ("ne", [2, 1]), ("sw", [-2, -1]), ("wn", [-1, 2])])
def test_positions_are_east_and_north(axes, place):
    text = gkf(f"<height-differences>{DH}</height-differences>", axes=f' axes-xy="{axes}"')
    assert parse_gama(text.encode()).positions[0].tolist() == place


def test_covariance_matrices_and_observed_heights():
    matrix = '<cov-mat dim="2" band="1">4 1\n 9</cov-mat>'
    text = gkf(
        f'<height-differences>{DH}<dh from="B" to="C" val="2"/>{matrix}</height-differences>'
        '<coordinates><point id="C" z="7"/><cov-mat dim="1" band="0">25</cov-mat></coordinates>'
    )
    network = parse_gama(text.encode())
    assert network.graph.tail.tolist() == [0, 1, EXTERNAL, EXTERNAL]
    expected = np.zeros((4, 4))
    expected[:3, :3] = np.array([[4, 1, 0], [1, 9, 0], [0, 0, 25]]) * 1e-6
    np.testing.assert_allclose(network.covariance.toarray(), expected, rtol=1e-15)
    assert_same(parse_gama(gama_text(network).encode()), network)


def test_a_plain_point_that_no_height_uses_is_no_node():
    points = POINTS + '<point id="D" x="1" y="2" adj="xy"/>'
    network = parse_gama(gkf(f"<height-differences>{DH}</height-differences>", points).encode())
    assert network.graph.names == ("A", "B", "C")


def point(attributes):
    return gkf(f"<height-differences>{DH}</height-differences>", f"{POINTS}<point {attributes}/>\n")


def readings(inside):
    return gkf(f"<coordinates>\n{inside}\n</coordinates>")


BAD = [
    ("", 1, "well-formed"),
    ("from,to,value\n", 1, "well-formed"),
    (cluster(DH).replace("</network>", ""), 15, "well-formed mismatched"),
    ("<svg/>", 1, "<svg> <gama-local>"),
    ('<?xml version="1.0"?>\n<!DOCTYPE gama-local [<!ENTITY a "b">]>\n<gama-local/>', 2, "DOCTYPE delete"),
    ('<!DOCTYPE x SYSTEM "file:///no/such">\n<gama-local/>', 1, "DOCTYPE"),
    ('<?xml version="1.0" encoding="no-such"?><gama-local/>', None, "encoding"),
    (cluster("&x;"), FIRST, "undefined entity"),
    (gkf(""), None, "no observation"),
    (cluster('<dh from="A" to="X" val="1" stdev="1"/>'), FIRST, "'X' declares"),
    (point('id="B" adj="z"'), 10, "'B' again line 8"),
    (point('id=" " adj="z"'), 10, "no id"),
    (point('id="D" fix="XYZ"'), 10, "fixed 'D' z="),
    (point('id="D" fix="z" z="high"'), 10, "'high'"),
    (point('id="D" adj="z" x="1" y="?"'), 10, "'?'"),
    (cluster('<dh from="A" to="B" stdev="1"/>'), FIRST, "no val="),
    (cluster('<dh from="A" to="B" val="nan" stdev="1"/>'), FIRST, "val 'nan' finite"),
    (cluster('<dh from="A" to="B" val="1,5" stdev="1"/>'), FIRST, "decimal point"),
    (cluster('<dh from="A" to="B" val="1" stdev="0"/>'), FIRST, "stdev positive"),
    (cluster('<dh from="A" to="B" val="1" stdev="1e-300"/>'), FIRST, "variance"),
    (cluster('<dh from="A" to="B" val="1" dist="-1"/>'), FIRST, "dist positive"),
    (cluster('<dh from="A" to="B" val="1"/>'), FIRST, "without stdev, dist"),
    (cluster('<dh from="A" to="A" val="1" stdev="1"/>'), FIRST, "self-loop 'A'"),
    (cluster('<dh to="A" val="1" stdev="1"/>'), FIRST, "without from"),
    (cluster('<dh from="A" val="1" stdev="1"/>'), FIRST, "no to="),
    (cluster('<dh from="A" to="B" val="1" stdv="1"/>'), FIRST, "'stdv' did you mean 'stdev'"),
    (gkf(DH), 10, "outside"),
    (gkf('<cov-mat dim="1" band="0">1</cov-mat>'), 10, "outside"),
    (gkf("<obs>\n<direction/></obs>"), 11, "<direction> height differences"),
    (gkf("<vectors/>"), 10, "<vectors>"),
    (gkf("<heights/>"), 10, "unknown <heights>"),
    (cluster(f'{DH}\n<cov-mat dim="1" band="1">1</cov-mat>'), FIRST + 1, "band < dim"),
    (cluster(f'{DH}\n<cov-mat dim="x" band="0">1</cov-mat>'), FIRST + 1, "dim='x' whole"),
    (cluster(f'{DH}\n<cov-mat dim="2" band="1">1 2</cov-mat>'), FIRST + 1, "2 numbers expected 3"),
    (cluster(f'{DH}\n<cov-mat dim="999999999" band="0">1 2</cov-mat>'), FIRST + 1, "2 numbers expected 999999999"),
    (cluster(f'{DH}\n<cov-mat dim="2" band="0">1 2</cov-mat>'), FIRST + 1, "dim=2 1 observations"),
    (cluster(f'{DH}{DH}\n<cov-mat dim="2" band="1">1 2 1</cov-mat>'), FIRST + 1, "positive definite"),
    (cluster(f'{DH}\n<cov-mat dim="1" band="0">inf</cov-mat>'), FIRST + 1, "finite"),
    (readings('<point id="B" x="1" y="2"/>'), FIRST, "x, y"),
    (readings('<point id="B"/>'), FIRST, "no z="),
    (readings('<point id="B" z="1"/>'), FIRST, "without stdev"),
    (readings('<point id="A" z="1"/><cov-mat dim="1" band="0">1</cov-mat>'), FIRST, "fixed point 'A'"),
    (gkf("", axes=' axes-xy="nn"'), 3, "axes-xy 'nn'"),
    (gkf("").replace("<points-obs", '<parameters sigma-apr="0"/><points-obs', 1), 6, "sigma-apr positive"),
]


@pytest.mark.parametrize(("text", "line", "words"), BAD)
def test_each_error_names_the_line_and_what_to_do(text, line, words):
    with pytest.raises(FileFormatError) as caught:
        parse_gama(text.encode(), "net.gkf")
    assert caught.value.line == line, str(caught.value)
    for word in words.split():
        assert word in str(caught.value)


def _comparable(network):
    """The network as Gama's order of arcs would have it: differences, readings, fixed points by node."""
    graph = network.graph
    fixed = sorted(np.flatnonzero(network.exact), key=lambda k: graph.head[k])
    return [*np.flatnonzero(~graph.is_external), *np.flatnonzero(graph.is_external & ~network.exact), *fixed]


@given(networks(names=XML_TEXT, awkward=False, sizes=(0,)))
@settings(max_examples=60, suppress_health_check=[HealthCheck.too_slow, HealthCheck.filter_too_much])
def test_what_is_written_is_read_back(network):
    graph = network.graph
    readings = np.bincount(graph.head[graph.is_external], minlength=graph.n_nodes)
    assume(all(name == name.strip() for name in graph.names))
    assume(not network.exact.all() and (readings[graph.head[network.exact]] == 1).all())
    assume(network.unit != "mm per km")
    again = parse_gama(gama_text(network).encode())
    order = _comparable(network)
    assert again.graph.names == graph.names
    np.testing.assert_array_equal(again.graph.tail, graph.tail[order])
    np.testing.assert_array_equal(again.graph.head, graph.head[order])
    np.testing.assert_array_equal(again.values, network.values[order])
    np.testing.assert_array_equal(again.exact, network.exact[order])
    np.testing.assert_allclose(dense(again), dense(network)[np.ix_(order, order)], rtol=1e-15, atol=0)
    assert again.known == tuple(sorted(graph.head[network.exact].tolist()))
    if network.positions is not None:
        np.testing.assert_array_equal(again.positions, network.positions)
    assert again.title == network.title


def test_correlated_differences_are_written_as_a_band(tmp_path):
    joint = sp.csr_array(np.array([[4.0, 1.0, 0.0], [1.0, 9.0, 2.0], [0.0, 2.0, 5.0]]))
    network = Network(MeasurementGraph(3, [0, 1, 0], [1, 2, 2]), [1.0, 2.0, 3.0], joint, unit="m")
    assert 'band="1"' in gama_text(network)
    save(network, tmp_path / "a.gkf")
    assert_same(load(tmp_path / "a.gkf"), network)


def _network(**changes):
    graph = MeasurementGraph(2, [0, EXTERNAL], [1, 0], changes.pop("weight", None), changes.pop("names", None))
    return Network(graph, changes.pop("values", [1.0, 2.0]), changes.pop("covariance", None), **changes)


@pytest.mark.parametrize(
    ("network", "words"),
    [
        (_network(values=np.ones((2, 2))), "one number an arc"),
        (_network(unit="mm"), "metres 'mm'"),
        (_network(weight=[1.0, 2.0]), "weights"),
        (_network(names=[" a", "b"]), "blanks"),
        (_network(names=["", "b"]), "empty"),
        (_network(names=["a\x01", "b"]), "cannot hold"),
        (_network(title="\x01"), "the title"),
        (_network(covariance=sp.csr_array([[4.0, 1.0], [1.0, 4.0]])), "correlated .json"),
        (Network(MeasurementGraph(1, [EXTERNAL], [0]), [1.0], exact=[True]), "nothing but exact"),
        (
            Network(MeasurementGraph(2, [0, EXTERNAL, EXTERNAL], [1, 0, 0]), [1, 2, 3], exact=[False, True, False]),
            "exact reading with_exact_readings_as_marks()",
        ),
    ],
)
def test_what_a_gkf_file_cannot_hold_is_refused(network, words):
    with pytest.raises(ArgumentError) as caught:
        gama_text(network)
    for word in words.split():
        assert word in str(caught.value)
