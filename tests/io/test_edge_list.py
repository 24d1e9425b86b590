"""Edge lists: what is read, every message with its line, and round trips."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings

from tests.io.drawn import assert_same, networks
from tests.machine import effort
from trigpoint.errors import ArgumentError, FileFormatError
from trigpoint.graphs import EXTERNAL, MeasurementGraph
from trigpoint.io import edge_list_text, load, parse_edge_list, save
from trigpoint.model import Network

H = "from,to,value,sigma\n"


def test_a_small_file_is_read_as_written():
    network = parse_edge_list(
        '\ufeff# Title\r\n# of it\r\nfrom,to,value,sigma,note\r\na,b,1.5,0.1,x\r\n,a,2,,"y, z"\r\n\r\n\r\n'
    )
    assert network.graph.names == ("a", "b")
    assert network.graph.tail.tolist() == [0, EXTERNAL]
    assert network.values.tolist() == [1.5, 2.0]
    assert network.exact.tolist() == [False, True]
    assert network.covariance[0] == 0.1**2
    assert network.title == "Title\nof it"
    assert network.columns == {"note": ("x", "y, z")}


def test_without_any_sigma_the_covariance_is_unknown_and_readings_are_exact():
    network = parse_edge_list("from,to,value\na,b,1\n,a,0\n")
    assert network.covariance is None
    assert network.exact.tolist() == [False, True]


def test_readings_with_sigma_beside_internal_rows_without_give_these_variance_one():
    network = parse_edge_list(H + "a,b,1,\n,a,0,2\n,b,1,\n")
    assert network.covariance.tolist() == [1.0, 4.0, 0.0]
    assert network.exact.tolist() == [False, False, True]


def test_vectors_with_each_way_to_say_their_spread():
    one = parse_edge_list("from,to,value_x,value_y,sigma\na,b,1,2,3\n")
    each = parse_edge_list("from,to,value_x,value_y,sigma_x,sigma_y\na,b,1,2,3,4\n")
    full = parse_edge_list("from,to,value_x,value_y,cov_xx,cov_xy,cov_yy\na,b,1,2,4,1,9\n,a,0,0,,,\n")
    assert one.covariance.tolist() == [[[9, 0], [0, 9]]]
    assert each.covariance.tolist() == [[[9, 0], [0, 16]]]
    assert full.covariance[0].tolist() == [[4, 1], [1, 9]]
    assert full.exact.tolist() == [False, True]
    assert full.values.shape == (2, 2)


def test_directives_give_unit_order_marks_and_places():
    text = '#@ unit m\n#@ node "z z"\n#@ known b\n#@ position b 1 2\nfrom,to,value\na,b,1\n,b,5\n'
    network = parse_edge_list(text)
    assert network.graph.names == ("z z", "a", "b")
    assert network.known == (2,)
    assert network.unit == "m"
    np.testing.assert_array_equal(network.positions, [[np.nan] * 2, [np.nan] * 2, [1, 2]])


def test_blanks_around_bare_fields_are_dropped_and_kept_in_quotes():
    network = parse_edge_list('from, to, value\na, b, 1\n" a", b ,2\n')
    assert network.graph.names == ("a", "b", " a")


def test_old_mac_line_ends_and_empty_columns_of_spreadsheets():
    assert parse_edge_list("from,to,value,,\ra,b,1,,\r").values.tolist() == [1.0]


def test_comments_between_rows_and_indented_ones_are_left_out():
    assert parse_edge_list("from,to,value\na,b,1\n# no\n  # no\n\nb,c,2\n").graph.n_arcs == 2


def test_tabs_in_tsv(tmp_path):
    path = tmp_path / "a.tsv"
    path.write_text("from\tto\tvalue\n\t#b\t1\nx, y\t#b\t1\n")
    network = load(path)
    assert network.graph.names == ("#b", "x, y")
    save(network, path)
    assert_same(load(path), network)


BAD = [
    ("", None, "no header"),
    ("# only a comment\n", None, "no header"),
    ("from,to,value\n", None, "no measurement"),
    ("from,to,val\na,b,1\n", 1, "no column 'value' did you mean 'val'"),
    ("form,to,value\na,b,1\n", 1, "no column 'from' did you mean 'form'"),
    ("# c\n\nfrom,value\na,1\n", 3, "no column 'to'"),
    ("from;to;value\na;b;1\n", 1, "semicolons commas"),
    ("from\tto\tvalue\na\tb\t1\n", 1, "tabs commas"),
    ("from,to,value,Sigma\na,b,1,1\n", 1, "'Sigma' did you mean 'sigma'"),
    ("from,to,value,value\na,b,1,1\n", 1, "'value' twice"),
    ("from,to,value,value_x\na,b,1,1\n", 1, "'value' beside"),
    ("from,to,value_x,value_z\na,b,1,1\n", 1, "no column 'value_y'"),
    ("from,to,value_x,value_y,sigma_x\na,b,1,1,1\n", 1, "sigma_x expected sigma_y"),
    ("from,to,value,sigma_x\na,b,1,1\n", 1, "sigma_x expected ['sigma']"),
    ("from,to,value,cov_xx\na,b,1,1\n", 1, "cov_xx expected 'sigma'"),
    ("from,to,value_x,value_y,cov_xx,cov_yy\na,b,1,1,1,1\n", 1, "expected cov_xy"),
    ("from,to,value,sigma,cov_xx\na,b,1,1,1\n", 1, "not both"),
    (H + "a,b,1,1\na,b,1\n", 3, "got 3 fields expected 4 fill"),
    (H + "a,b,1,1\na,b,1,1,5\n", 3, "got 5 fields expected 4 quotes"),
    (H + "a,b,nan,1\n", 2, "'value' 'nan' finite"),
    (H + "a,b,1,1\na,b,-inf,1\n", 3, "'value' finite"),
    (H + "a,b,1e999,1\n", 2, "finite"),
    (H + "a,b,one,1\n", 2, "'value' 'one' number"),
    (H + "a,b,1_000,1\n", 2, "'1_000' number"),
    (H + 'a,b,"1,5",1\n', 2, "decimal point"),
    (H + "a,b,,1\n", 2, "'value' nothing"),
    (H + "a,b,1,0\n", 2, "sigma positive"),
    (H + "a,b,1,-2\n", 2, "sigma positive"),
    (H + "a,b,1,1e-200\n", 2, "square unit"),
    (H + "a,b,1,1e200\n", 2, "square unit"),
    (H + "a,b,1,1\na,b,1,\n", 3, "no sigma line 2 every internal row"),
    (H + "a,b,1,1\n\nb,b,1,1\n", 4, "self-loop 'b'"),
    (H + "a,,1,1\n", 2, "empty 'to'"),
    (H + ",,,\n", 2, "empty 'to'"),
    (H + 'a,b,1,1\n"a\nb,c,1,1\n', 3, "quote never closed"),
    (H + '"two\nlines",b,1,1\n"a"x,b,1,1\n', 4, "'x' after a closing quote"),
    (H + '"two\nlines",b,1,1\na,b,x,1\n', 4, "'x'"),
    (H + '"' + "a" * 1_000_001 + '",b,1,1\n', 2, "1 MB"),
    (H + "a" * 1_000_001 + ",b,1,1\n", 2, "1 MB"),
    (H + '"a",' + "b" * 1_000_001 + ",1,1\n", 2, "1 MB"),
    ("from,to,value\n,a,1\n,a,2\n", 3, "second exact 'a' contradicts"),
    ("from,to,value_x,value_y,cov_xx,cov_xy,cov_yy\na,b,1,1,1,2,1\n", 2, "not positive definite"),
    ("from,to,value_x,value_y,cov_xx,cov_xy,cov_yy\na,b,1,1,1,,1\n", 2, "only some cov_xy is missing"),
    ("from,to,value,\na,b,1,5\n", 2, "column without a name"),
    ("#@ know b\nfrom,to,value\na,b,1\n", 1, "'#@ know' did you mean 'known'"),
    ("#@\nfrom,to,value\na,b,1\n", 1, "expected one of"),
    ("#@ position b 1\nfrom,to,value\na,b,1\n", 1, "NAME X Y"),
    ("#@ position b 1 x\nfrom,to,value\na,b,1\n", 1, "position 'b' 'x'"),
    ("#@ position c 1 2\nfrom,to,value\na,b,1\n", 1, "'c' no row mentions"),
    ("from,to,value\n#@ node a\n#@ node a\na,b,1\n", 3, "twice"),
    ("#@ known a\nfrom,to,value\na,b,1\n", 1, "exactly one"),
    ("#@ known a\nfrom,to,value,sigma\na,b,1,1\n,a,1,1\n", 1, "exactly one"),
]


@pytest.mark.parametrize(("text", "line", "words"), BAD)
def test_each_error_names_the_line_and_what_to_do(text, line, words):
    with pytest.raises(FileFormatError) as caught:
        parse_edge_list(text, "net.csv")
    assert caught.value.line == line
    start = "net.csv: " if line is None else f"net.csv:{line}: "
    assert str(caught.value).startswith(start)
    for word in words.split():
        assert word in str(caught.value)
    assert len(str(caught.value)) < 400


@pytest.mark.parametrize(("data", "line"), [(b"from,to,value\na,\0,1\n", 2), (b"from,to,value\na,\xff,1\n", 2)])
def test_binary_content_is_refused(tmp_path, data, line):
    path = tmp_path / "a.csv"
    path.write_bytes(data)
    with pytest.raises(FileFormatError, match="UTF-8") as caught:
        load(path)
    assert caught.value.line == line


@given(networks())
@settings(max_examples=150)
def test_what_is_written_is_read_back(network):
    for delimiter in (",", "\t"):
        text = edge_list_text(network, delimiter)
        again = parse_edge_list(text, delimiter=delimiter)
        assert_same(again, network)
        assert edge_list_text(again, delimiter) == text


def test_unit_weights_with_a_soft_reading_come_back_as_ones():
    network = Network(MeasurementGraph(2, [0, EXTERNAL], [1, 0]), [1.0, 2.0])
    again = parse_edge_list(edge_list_text(network))
    assert again.exact.tolist() == [False, False]
    assert again.covariance.tolist() == [1.0, 1.0]


def _network(**changes):
    graph = MeasurementGraph(2, [0, 0], [1, 1], changes.pop("weight", None), changes.pop("names", None))
    return Network(graph, changes.pop("values", [1.0, 2.0]), changes.pop("covariance", None), **changes)


@pytest.mark.parametrize(
    ("network", "words"),
    [
        (_network(weight=[1.0, 2.0]), "weights .json"),
        (_network(names=["", "b"]), "empty name"),
        (_network(names=["a\0", "b"]), "cannot hold"),
        (_network(names=["a\ud800", "b"]), "cannot hold"),
        (_network(columns={"value_x": ["", ""]}), "value_x"),
        (_network(columns={"": ["", ""]}), "rename"),
        (_network(values=np.ones((2, 4))), "up to 3"),
        (Network(MeasurementGraph(1, [], []), np.zeros(0)), "no measurement"),
    ],
)
def test_what_an_edge_list_cannot_hold_is_refused(network, words):
    with pytest.raises(ArgumentError) as caught:
        edge_list_text(network)
    for word in words.split():
        assert word in str(caught.value)


def test_a_sparse_covariance_is_written_where_arcs_are_uncorrelated():
    import scipy.sparse as sp

    free = _network(covariance=sp.csr_array(np.diag([4.0, 9.0])))
    assert parse_edge_list(edge_list_text(free)).covariance.tolist() == [4.0, 9.0]
    joint = _network(covariance=sp.csr_array([[4.0, 1.0], [1.0, 9.0]]))
    with pytest.raises(ArgumentError, match="correlated"):
        edge_list_text(joint)


def test_a_hundred_thousand_rows_are_read_in_seconds():
    rows = [f"n{k},n{k + 1},{k * 0.001},0.5" for k in range(100_000)]
    with effort() as spent:
        network = parse_edge_list(H + "\n".join(rows))
    assert spent.units < 500.0
    assert network.graph.n_nodes == 100_001


def test_the_fast_path_and_the_careful_path_agree():
    rows = "a,b,1,1\n b,c , 2,1\r\n,a,5,\n"
    assert_same(parse_edge_list(H + rows), parse_edge_list(H + rows + "# careful\n"))
