"""JSON node-link and GraphML: round trips, networkx in and out, every message."""

from __future__ import annotations

import json

import networkx as nx
import numpy as np
import pytest
import scipy.sparse as sp
from hypothesis import given, settings

from tests.io.drawn import XML_TEXT, assert_same, networks
from trigpoint.errors import ArgumentError, FileFormatError
from trigpoint.graphs import EXTERNAL, MeasurementGraph, grid
from trigpoint.io import graphml_text, load, nodelink_text, parse_graphml, save
from trigpoint.io.nodelink import nodelink_from_document
from trigpoint.model import Network


def parse_nodelink(text):
    return nodelink_from_document(json.loads(text), "net.json")


@given(networks())
@settings(max_examples=80)
def test_json_that_is_written_is_read_back(network):
    assert_same(parse_nodelink(nodelink_text(network)), network)


@given(networks(names=XML_TEXT))
@settings(max_examples=80)
def test_graphml_that_is_written_is_read_back(network):
    assert_same(parse_graphml(graphml_text(network).encode()), network)


def weighted(weight):
    return MeasurementGraph(3, [0, 1, EXTERNAL, 0], [1, 2, 2, 1], weight, ["c", "a", "b"])


@pytest.mark.parametrize("weight", [None, [1.0, 2.0, 3.0, 4.0]])
@pytest.mark.parametrize("suffix", [".json", ".graphml"])
def test_a_bare_graph_comes_back_as_a_graph(tmp_path, weight, suffix):
    graph = weighted(weight)
    save(graph, tmp_path / f"a{suffix}")
    again = load(tmp_path / f"a{suffix}")
    assert isinstance(again, MeasurementGraph)
    assert again.names == graph.names
    assert again.tail.tolist() == graph.tail.tolist()
    assert again.head.tolist() == graph.head.tolist()
    np.testing.assert_array_equal(again.arc_weights, graph.arc_weights)


@pytest.mark.parametrize("suffix", [".json", ".graphml"])
def test_weights_stay_beside_values(tmp_path, suffix):
    network = Network(weighted([1.0, 2.0, 3.0, 4.0]), [1.0, 2.0, 3.0, 4.0], [1.0, 2.0, 3.0, 4.0])
    save(network, tmp_path / f"a{suffix}")
    assert_same(load(tmp_path / f"a{suffix}"), network)


def test_json_holds_weight_blocks_and_joint_covariances():
    blocks = np.array([np.eye(2), 2 * np.eye(2), np.eye(2), np.array([[2.0, 1.0], [1.0, 2.0]])])
    np.testing.assert_array_equal(parse_nodelink(nodelink_text(weighted(blocks))).weight, blocks)
    joint = sp.csr_array(np.array([[4.0, 1.0, 0, 0], [1.0, 9.0, 0, 2.0], [0, 0, 0, 0], [0, 2.0, 0, 5.0]]))
    network = Network(weighted(None), [1.0, 2.0, 3.0, 4.0], joint, exact=[False, False, True, False], known=[2])
    again = parse_nodelink(nodelink_text(network))
    assert sp.issparse(again.covariance)
    assert_same(again, network)


def test_networkx_reads_our_files_and_we_read_its(tmp_path):
    network = Network(weighted(None), [1.0, 2.0, 3.0, 4.0], [1.0, 2.0, 3.0, 4.0])
    save(network, tmp_path / "ours.graphml")
    theirs = nx.read_graphml(tmp_path / "ours.graphml", force_multigraph=True)
    assert theirs.edges["c", "a", 0]["value"] == 1.0
    nx.write_graphml(theirs, tmp_path / "theirs.graphml")
    again = load(tmp_path / "theirs.graphml")
    assert again.graph.names == network.graph.names
    assert sorted(again.values.tolist()) == [1.0, 2.0, 3.0, 4.0]
    data = json.loads(nodelink_text(network))
    assert nx.node_link_graph(data, edges="links").edges["c", "a", 3]["value"] == 4.0
    written = json.dumps(nx.node_link_data(theirs, edges="edges"))
    assert sorted(parse_nodelink(written).values.tolist()) == [1.0, 2.0, 3.0, 4.0]


def test_undirected_graphs_and_arcs_into_the_environment_without_values():
    graph = parse_nodelink('{"nodes": [{"id": 1}, {"id": ""}], "links": [{"source": 1, "target": ""}]}')
    assert graph.is_external.tolist() == [True]
    assert graph.names == ("1",)
    save_as = nx.node_link_data(grid(2, 2).to_networkx().to_undirected(), edges="links")
    assert parse_nodelink(json.dumps(save_as)).n_arcs == 5


def nodes(*entries):
    return {"directed": True, "nodes": [{"id": "a"}, {"id": "b"}, {"id": ""}], "links": list(entries)}


def arc(start="a", end="b", **attributes):
    return {"source": start, "target": end, **attributes}


BAD_JSON = [
    ([], "list object"),
    ({"a": 1}, "keys nodes"),
    ({"nodes": [], "links": []}, "no node"),
    ({"nodes": [3], "links": []}, "node 0 id"),
    ({"nodes": [{"id": None}], "links": []}, "node 0 name"),
    ({"nodes": [{"id": 1}, {"id": "1"}], "links": []}, "node 1 twice"),
    ({"nodes": [{"id": "a"}], "links": [1]}, "edge 0 source"),
    ({"nodes": [{"id": "a"}], "links": [], "directed": 1}, "wrong type"),
    (nodes(arc("a", "x")), "edge 0 'x' not listed"),
    (nodes(arc("a", "a")), "edge 0 self-loop"),
    (nodes(arc("", "")), "edge 0"),
    (nodes(arc("a", "", value=1)), "edge 0 into the environment"),
    (nodes(arc(value=1), arc()), "edge 1 'value' nothing"),
    (nodes(arc(value="x")), "edge 0 'x' number"),
    (nodes(arc(value=True)), "edge 0 'True' number"),
    (nodes(arc(value=[1])), "edge 0 number"),
    (nodes(arc(sigma=1)), "no column 'value'"),
    (nodes(arc(value=1, sigma=0)), "edge 0 positive"),
    (nodes(arc(value=1, sigma=1), arc(value=1)), "edge 1 no sigma edge 0"),
    (nodes(arc(weight=0)), "edge 0 weight positive"),
    (nodes(arc(weight="x")), "edge 0 weight number"),
    (nodes(arc(weight=[[1, 2]])), "weight"),
    (nodes(arc(value=1, weight=[[1, 2]])), "weight"),
    ({**nodes(arc(value=1)), "directed": False}, "undirected"),
    ({**nodes(arc(value=1)), "graph": {"covariance": {"rows": [0]}}}, "covariance symmetric"),
    ({**nodes(arc(value=1)), "graph": {"covariance": {"rows": [0], "columns": [0], "entries": [-1]}}}, "no covariance"),
    ({"directed": True, "nodes": [{"id": "a", "known": 1}, {"id": "b"}], "links": [arc(value=1)]}, "known true"),
    ({"directed": True, "nodes": [{"id": "a", "known": True}, {"id": "b"}], "links": [arc(value=1)]}, "known exactly"),
    (
        {"directed": True, "nodes": [{"id": "a", "x": 1, "y": "?"}, {"id": "b"}], "links": [arc(value=1)]},
        "position '?'",
    ),
]


@pytest.mark.parametrize(("document", "words"), BAD_JSON)
def test_each_error_of_json_says_where(document, words):
    with pytest.raises(FileFormatError) as caught:
        nodelink_from_document(document, "net.json")
    assert str(caught.value).startswith("net.json: ")
    for word in words.split():
        assert word in str(caught.value)


@pytest.mark.parametrize(
    ("text", "line", "words"),
    [
        ("{\n", 2, "no JSON"),
        ('{\n"a": NaN}', 2, "NaN"),
        ("[-Infinity]", 1, "-Infinity"),
        ("[" * 100_000, None, "cannot be read"),
        ('{"kind": "trigpoint/nothing"}', None, "kind 'trigpoint/nothing'"),
    ],
)
def test_what_is_no_json_is_refused_with_its_line(tmp_path, text, line, words):
    path = tmp_path / "a.json"
    path.write_text(text)
    with pytest.raises(FileFormatError) as caught:
        load(path)
    assert caught.value.line == line
    for word in words.split():
        assert word in str(caught.value)


def graphml(inside, default="directed"):
    keys = '<key id="v" for="edge" attr.name="value" attr.type="double"/>\n'
    keys += '<key id="k" for="node" attr.name="known" attr.type="boolean"><default>false</default></key>\n'
    return (
        f'<graphml>\n{keys}<graph edgedefault="{default}">\n<node id="a"/><node id="b"/>\n{inside}\n</graph></graphml>'
    )


def edge(data="1", ends='source="a" target="b"'):
    return f'<edge {ends}><data key="v">{data}</data></edge>'


def test_defaults_hold_where_nothing_is_given():
    text = graphml('<edge source="a" target="b"/>').replace('"double"/>', '"double"><default>7</default></key>')
    assert parse_graphml(text.encode()).values.tolist() == [7.0]


@pytest.mark.parametrize(
    ("text", "line", "words"),
    [
        ("<graphml>\n", 2, "well-formed"),
        ("<gama/>", 1, "<gama> <graphml>"),
        ('<!DOCTYPE graphml [<!ENTITY a SYSTEM "file:///no/such">]>\n<graphml>&a;</graphml>', 1, "DOCTYPE"),
        (graphml("<hyperedge/>"), 6, "<hyperedge>"),
        (graphml('<node id="a"/>'), 6, "'a' twice"),
        (graphml("<node/>"), 6, "without id"),
        (graphml('<edge source="a"/>'), 6, "without target"),
        (graphml('<edge source="a" target="b" directed="false"/>'), 6, "undirected"),
        (graphml('\n<edge source="a" target="x"/>'), 7, "'x' not listed"),
        (graphml(edge("one")), 6, "value 'one'"),
        (graphml(edge("nan")), 6, "value finite"),
        (graphml(edge() + '\n<edge source="a" target="b"/>'), 7, "nothing"),
        (graphml(edge().replace('"v"', '"w"')), 6, "'w' <key>"),
        (graphml('<node id="c"><data key="k">perhaps</data></node>'), 6, "known 'perhaps'"),
        (graphml(edge(), "undirected"), None, "undirected"),
        (graphml('<node id="c"><graph/></node>'), 6, "inside"),
        (graphml(edge(ends='source="a" target="a"')), 6, "self-loop"),
    ],
)
def test_each_error_of_graphml_names_the_line(text, line, words):
    with pytest.raises(FileFormatError) as caught:
        parse_graphml(text.encode(), "net.graphml")
    assert caught.value.line == line, str(caught.value)
    for word in words.split():
        assert word in str(caught.value)


def _network(**changes):
    graph = MeasurementGraph(2, [0, 0], [1, 1], None, changes.pop("names", None))
    return Network(graph, changes.pop("values", [1.0, 2.0]), changes.pop("covariance", None), **changes)


@pytest.mark.parametrize(
    ("write", "data", "words"),
    [
        (nodelink_text, _network(names=["", "b"]), "empty name"),
        (nodelink_text, _network(columns={"key": ["", ""]}), "'key'"),
        (nodelink_text, _network(values=np.ones((2, 4))), "up to 3"),
        (graphml_text, weighted(np.array([np.eye(2)] * 4)), "blocks .json"),
        (graphml_text, _network(names=["a\x01", "b"]), "cannot hold"),
        (graphml_text, _network(covariance=sp.csr_array([[4.0, 1.0], [1.0, 9.0]])), "correlated .json"),
    ],
)
def test_what_the_format_cannot_hold_is_refused(write, data, words):
    with pytest.raises(ArgumentError) as caught:
        write(data)
    for word in words.split():
        assert word in str(caught.value)
