"""Scenario files: what they mean, and every message with its line."""

from __future__ import annotations

import tomllib
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from trigpoint.errors import FileFormatError
from trigpoint.graphs import EXTERNAL, MeasurementGraph, grid, random_connected
from trigpoint.io import load, parse_scenario, read_scenario, save
from trigpoint.io.sections import GALLERY
from trigpoint.io.toml_lines import key_lines
from trigpoint.model import Network

PLANT = """[plant]
A = [[-2, 0], [0, -3]]
outputs = [[[1, 0]], [[0, 1]]]
neighbours = [[1], []]
"""
GRID = '[network]\ngallery = {kind = "grid", rows = 2, cols = 3, anchors = [5]}\n'

FULL = """\
[network]
arcs = [
  {from = "a", to = "b", value = 1.5, sigma = 0.1},
  ["b", "c", 2.0, 0.2],  # a list does as well
  {to = "c", value = 3, sigma = 0.2},
]
fixed = {a = 7.0}
[agent]
A = [[0, 1], [0, 0]]
C = [[1, 0]]
B = [[0], [1]]
E = [[0], [1]]
[design]
gain = 2.5
margin = 1.1
max_nodes = 100
weights = "precision"
process = [[1, 0], [0, 1]]
measurement = 0.5
[simulate]
horizon = 10
samples = 3
period = 0.1
initial_error = [1, 2]
noise = {process = true, measurement = 0.1}
loss = 0.2
seed = 5
path = "stacked"
[run]
rate = 10
transport = "quic"
security = "keys"
stale = 0.5
agents_per_process = 4
addresses = {a = "quic/127.0.0.1:7447"}
"""


def test_a_full_scenario_is_read():
    scenario = parse_scenario(FULL, "s.toml")
    network = scenario.network
    assert network.graph.names == ("a", "b", "c")
    assert network.graph.tail.tolist() == [0, 1, EXTERNAL, EXTERNAL]
    assert network.known == (0,)
    assert network.exact.tolist() == [False, False, False, True]
    np.testing.assert_allclose(network.covariance, [0.01, 0.04, 0.04, 0.0])
    assert scenario.graph is network.graph
    assert scenario.agent.B.shape == (2, 1)
    assert scenario.design.gain == 2.5
    assert scenario.design.measurement.tolist() == [[0.5]]
    assert scenario.simulate.instants.tolist() == [0.0, 5.0, 10.0]
    assert scenario.simulate.noise.process is True
    assert (scenario.run.transport, scenario.run.security, scenario.run.agents_per_process) == ("quic", "keys", 4)
    assert (scenario.run.stale, scenario.run.window, scenario.run.old) == (0.5, None, "propagate")
    assert scenario.run.addresses == {"a": "quic/127.0.0.1:7447"}


def test_defaults():
    scenario = parse_scenario(GRID, "s.toml")
    assert isinstance(scenario.network, MeasurementGraph)
    assert scenario.graph is scenario.network
    assert scenario.network.head.tolist() == grid(2, 3, (5,)).head.tolist()
    assert scenario.agent is None
    assert scenario.simulate is None
    assert (scenario.design.method, scenario.design.gain, scenario.design.weights) == (
        None,
        "from-graph",
        "unit",
    )
    simulate = parse_scenario(GRID + "[simulate]\n", "s.toml").simulate
    assert simulate.instants is None
    assert parse_scenario(GRID + "[simulate]\nhorizon = 2.0\n", "s.toml").simulate.instants.shape == (201,)
    assert parse_scenario(GRID + "[simulate]\ntimes = [1, 2.5]\n", "s.toml").simulate.instants.tolist() == [1.0, 2.5]


@pytest.mark.parametrize(
    "gallery",
    [
        '{kind = "chain", n = 3}',
        '{kind = "cycle", n = 3, anchors = [1]}',
        '{kind = "complete", n = 3}',
        '{kind = "star", n = 3}',
        '{kind = "random_connected", n = 9, connectivity = 0.5, seed = 3}',
        '{kind = "within_radius", positions = [[0, 0], [1, 0]], radius = 1.5, anchors = [0]}',
    ],
)
def test_every_gallery_network(gallery):
    graph = parse_scenario(f"network.gallery = {gallery}\n", "s.toml").network
    assert graph.n_arcs > 0
    if "random" in gallery:
        assert graph.head.tolist() == random_connected(9, 0.5, np.random.default_rng(3)).head.tolist()


def test_arcs_from_a_file_beside_the_scenario(tmp_path):
    (tmp_path / "net.csv").write_text("# t\n#@ unit m\nfrom,to,value_x,value_y,sigma,n\na,b,1,2,1,x\n,a,0,0,1,y\n")
    path = tmp_path / "s.toml"
    path.write_bytes(b'\xef\xbb\xbf[network]\r\narcs = "net.csv"\r\n[network.fixed]\r\nb = [1, 2]\r\n')
    network = load(path).network
    assert network.known == (1,)
    assert network.values.shape == (3, 2)
    assert network.covariance[2].tolist() == [[0, 0], [0, 0]]
    assert network.columns == {"n": ("x", "y", "")}
    assert (network.title, network.unit) == ("t", "m")


def test_fixed_points_beside_joint_covariances_and_weights(tmp_path):
    import scipy.sparse as sp

    joint = sp.csr_array([[2.0, 1.0], [1.0, 2.0]])
    save(Network(MeasurementGraph(2, [0, 0], [1, 1], [2.0, 3.0]), [1.0, 2.0], joint), tmp_path / "net.json")
    (tmp_path / "s.toml").write_text('[network]\narcs = "net.json"\nfixed = {0 = 1}\n')
    network = read_scenario(tmp_path / "s.toml").network
    assert network.covariance.toarray().tolist() == [[2, 1, 0], [1, 2, 0], [0, 0, 0]]
    assert network.graph.weight.tolist() == [2.0, 3.0, 1.0]


def test_a_fixed_value_equal_to_an_exact_reading_makes_it_a_mark():
    text = '[network]\narcs = [["a", "b", 1], {to = "a", value = 2}]\nfixed = {a = 2}\n'
    network = parse_scenario(text, "s.toml").network
    assert network.graph.n_arcs == 2
    assert network.known == (0,)


def test_inline_arcs_without_values_are_a_bare_graph():
    graph = parse_scenario('[network]\narcs = [["a", "b"], ["", "a"], {from = 1, to = "b"}]\n', "s.toml").network
    assert isinstance(graph, MeasurementGraph)
    assert graph.names == ("a", "b", "1")
    assert graph.is_external.tolist() == [False, True, False]


def test_inline_vectors():
    text = '[network]\narcs = [["a", "b", [1, 2], 0.5], {to = "a", value = [0, 0], sigma = [1, 2]}]\n'
    network = parse_scenario(text, "s.toml").network
    assert network.covariance.tolist() == [[[0.25, 0], [0, 0.25]], [[1, 0], [0, 4]]]


def arcs(rows):
    return f"[network]\narcs = [\n{rows}\n]\n"


BAD = [
    ("x = [\n", 2, "no TOML"),
    ("a = 1\na = 2\n", 2, "no TOML"),
    ("x = " + "[" * 5000, None, "TOML"),
    ("", None, "neither of [network] [plant]"),
    (PLANT + GRID, 1, "both of [network] [plant]"),
    (PLANT.replace("[[1], []]", "[[1]]"), 4, "1 lists one an agent of outputs (2)"),
    (PLANT.replace("[[1], []]", "[[2], []]"), 1, "agent 0 hears 2"),
    (PLANT.replace("A = [[-2, 0], [0, -3]]", "A = [[-2, 0]]"), 2, "A must be square"),
    ("network = 3\n", 1, "network 3 table"),
    ("[[network]]\n", 1, "network table"),
    ("[network]\n", 1, "neither arcs nor gallery"),
    (GRID + 'arcs = "a.csv"\n', 1, "both arcs and gallery"),
    (GRID + "[simulat]\n", 3, "'simulat' top did you mean 'simulate'"),
    ("[network]\nacrs = 1\n", 2, "'acrs' [network] did you mean 'arcs'"),
    (GRID + "[simulate]\nhorzon = 1\n", 4, "'horzon' [simulate] did you mean 'horizon'"),
    (GRID + "[simulate]\nnoise = {proces = 1}\n", 4, "'proces' [simulate.noise] did you mean 'process'"),
    (GRID + "[run]\nrates = 1\n", 4, "'rates' did you mean 'rate'"),
    (
        GRID + '[run]\nrate = 9\ntransport = "pigeon"\n',
        5,
        "run.transport: got 'pigeon', expected 'unixsock'",
    ),
    (GRID + "design.gian = 1\n", 3, "'design' [network]"),
    ("design.gian = 1\n" + GRID, 1, "'gian' [design] did you mean 'gain'"),
    (GRID + '[design]\ngain = "best"\n', 4, "design.gain 'best' 'worst-case'"),
    (GRID + "[design]\ngain = -1\n", 4, "design.gain -1 positive"),
    (GRID + "[design]\ngain = true\n", 4, "design.gain True"),
    (GRID + "[design]\nmargin = nan\n", 4, "design.margin nan finite"),
    (GRID + "[design]\nmargin = 0.5\n", 4, "design.margin 0.5 1"),
    (GRID + '[design]\nweights = "sum"\n', 4, "'sum' 'unit' 'precision'"),
    (GRID + "[design]\nmethod = 3\n", 4, "design.method 3 string"),
    (GRID + "[design]\nprocess = [[1, 2], [0, 1]]\n", 4, "covariance symmetric"),
    (GRID + "[design]\nmeasurement = -1\n", 4, "covariance"),
    (GRID + "[agent]\nA = 0\n", 3, "no agent.C add"),
    (GRID + "[agent]\nA = [[0, 1], [0]]\nC = 1\n", 4, "agent.A equal length"),
    (GRID + "[agent]\nA = [[0, '1'], [0, 0]]\nC = 1\n", 4, "agent.A matrix"),
    (GRID + "[agent]\nA = 0\nC = [[\n1, inf]]\n", 6, "agent.C.0.1 inf finite"),
    (GRID + "[agent]\nA = [[0, 1], [0, 0]]\n\nC = 1\n", 6, "C (2, 2) (1, 1)"),
    (GRID + "[agent]\nA = [[0, 1]]\nC = 1\n", 4, "A square (1, 2)"),
    (GRID + "[simulate]\ntimes = [0, 2, 1]\n", 4, "simulate.times increasing"),
    (GRID + "[simulate]\ntimes = 3\n", 4, "simulate.times list"),
    (GRID + "[simulate]\ntimes = [1]\nhorizon = 2\n", 3, "times beside horizon"),
    (GRID + "[simulate]\nsamples = 3\n", 3, "samples without horizon"),
    (GRID + "[simulate]\nhorizon = 0\n", 4, "simulate.horizon 0 greater"),
    (GRID + "[simulate]\nseed = 1.5\n", 4, "simulate.seed 1.5 integer"),
    (GRID + "[simulate]\nloss = true\n", 4, "simulate.loss True number"),
    (GRID + "[simulate]\ninitial_error = ['a']\n", 4, "simulate.initial_error number"),
    (GRID + "[simulate]\nnoise = {process = 'x'}\n", 4, "simulate.noise.process 'x'"),
    (GRID + "[simulate]\npath = 'fast'\n", 4, "'auto'"),
    ('network.gallery = {kind = "gird"}\n', 1, "'gird' did you mean 'grid'"),
    ("network.gallery = {rows = 3}\n", 1, "kind None"),
    ('[network.gallery]\nkind = "grid"\nrow = 1\ncols = 2\n', 3, "'row' did you mean 'rows'"),
    ('[network.gallery]\nkind = "grid"\nrows = 0\ncols = 2\n', 3, "network.gallery.rows 0"),
    ('[network]\n\ngallery = {kind = "chain", n = 3, anchors = [3]}\n', 3, "network.gallery anchors[0]"),
    ('[network]\narcs = "no.csv"\n', 2, "'no.csv' no file"),
    ('[network]\narcs = "no.txt"\n', 2, "'.txt' .csv"),
    ("[network]\narcs = 3\n", 2, "network.arcs 3"),
    (arcs('["a", "b", 1],\n3'), 4, "network.arcs.1 from"),
    (arcs('["a", "b", 1],\n["a"]'), 4, "network.arcs.1 from"),
    (arcs('["a", "b", 1],\n[true, "b", 1]'), 4, "True name"),
    (arcs('["a", "b", 1],\n["a", "b"]'), 4, "no value"),
    (arcs('{from = "a", to = "b", sigma = 1}'), 3, "sigma without a value"),
    (arcs('["a", "b", 1, 1],\n["a", "b", 1]'), 4, "no sigma"),
    (arcs('["a", "b", 1, 0]'), 3, "sigma positive"),
    (arcs('["a", "b", [1, 2]],\n["a", "b", 1]'), 4, "2 numbers"),
    (arcs('["a", "b", [1, 2, 3, 4]]'), 3, "1 to 3"),
    (arcs('["a", "b", "x"]'), 3, "network.arcs.0.value 'x'"),
    (arcs('["a", "a"]'), 3, "self-loop"),
    (arcs('["a", ""]'), 3, "empty 'to'"),
    (arcs('{from = "a", vlue = 1}'), 3, "'vlue' did you mean 'value'"),
    ('[[network.arcs]]\nfrom = "a"\nto = "b"\n\n[[network.arcs]]\nfrom = "a"\n', 5, "no network.arcs.1.to"),
    (GRID + "[network.fixed]\n0 = 1\n", 3, "without values"),
    (arcs('["a", "b", 1]') + "fixed = {c = 1}\n", 5, "'c' no arc mentions"),
    (arcs('["a", "b", 1]') + "fixed.a = [1, 2]\n", 5, "[1, 2] 1 numbers"),
    (arcs('["a", "b", 1]') + "fixed.a = 'x'\n", 5, "network.fixed.a 'x'"),
    (arcs('["a", "b", 1], {to = "a", value = 1}') + "\n[network.fixed]\na = 2\n", 7, "'a' absolute reading"),
    (arcs('["a", "b", 1, 1], ["", "a", 1, 1]') + "fixed.a = 1\n", 5, "'a' absolute reading"),
]


@pytest.mark.parametrize(("text", "line", "words"), BAD)
def test_each_error_names_the_line_the_key_and_what_to_do(text, line, words):
    with pytest.raises(FileFormatError) as caught:
        parse_scenario(text, "s.toml")
    assert caught.value.line == line, str(caught.value)
    assert str(caught.value).startswith("s.toml")
    for word in words.split():
        assert word in str(caught.value)


def test_an_error_in_the_arcs_file_names_that_file(tmp_path):
    (tmp_path / "net.csv").write_text("from,to,value\na,b,x\n")
    (tmp_path / "s.toml").write_text('[network]\narcs = "net.csv"\n')
    with pytest.raises(FileFormatError, match=r"net\.csv:2: "):
        load(tmp_path / "s.toml")


TRICKY = '''\
a = """
[not.a.table]
x = 1
"""
"quoted key".b = 'x # no comment' # comment
[t]   # [u]
'c' = [ # [
  1, "]",
  {d = [2, 3], e."f g" = """}"""},
]
[[list]]
x = 1979-05-27T07:32:00Z
[[list]]
y = "\\"]"
[list.sub]
z = -1.5e3
'''


def test_lines_of_keys_in_a_tricky_text():
    lines = key_lines(TRICKY)
    expected = {("a",): 1, ("quoted key", "b"): 5, ("t",): 6, ("t", "c"): 7, ("t", "c", 1): 8, ("t", "c", 2, "d", 1): 9}
    expected |= {("t", "c", 2, "e", "f g"): 9, ("list", 0, "x"): 12, ("list", 1): 13, ("list", 1, "y"): 14}
    expected |= {("list", 1, "sub", "z"): 16}
    assert {path: lines.get(path) for path in expected} == expected
    assert set(paths(tomllib.loads(TRICKY), ())) <= set(lines)


def paths(value, at):
    if at:
        yield at
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, entry in items:
        yield from paths(entry, (*at, key))


TOML_VALUES = st.recursive(
    st.one_of(st.integers(), st.booleans(), st.text(st.sampled_from("a]}#,='\"\n "), max_size=5)),
    lambda inner: st.one_of(
        st.lists(inner, max_size=3), st.dictionaries(st.sampled_from(["a", "b", "c d"]), inner, max_size=3)
    ),
    max_leaves=8,
)


@given(st.dictionaries(st.sampled_from(["a", "b", "c d"]), TOML_VALUES, max_size=3))
@settings(max_examples=80, deadline=None)
def test_every_key_of_drawn_documents_has_a_line(document):
    import tomlkit

    text = tomlkit.dumps(document)
    assert set(paths(tomllib.loads(text), ())) <= set(key_lines(text))


def test_a_plant_is_read():
    plant = parse_scenario(PLANT, "plant.toml").plant
    assert plant is not None
    assert plant.hears == ((1,), ())
    assert [output.tolist() for output in plant.outputs] == [[[1, 0]], [[0, 1]]]


@pytest.mark.parametrize("kind", sorted(GALLERY))
def test_the_reference_names_every_key_of_a_gallery_network(kind) -> None:
    text = (Path(__file__).parents[2] / "docs" / "reference" / "formats.md").read_text(encoding="utf-8")
    row = next(line for line in text.splitlines() if line.startswith("|") and f"`{kind}`" in line.split("|")[1])
    assert [key for key in GALLERY[kind].model_fields if f"`{key}`" not in row] == []
