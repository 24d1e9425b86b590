"""Node files and observer documents: everything comes back; what is malformed is a ``ProtocolError``, nothing else."""

from __future__ import annotations

import copy
import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from trigpoint.arrays import encode_array
from trigpoint.errors import ProtocolError
from trigpoint.graphs import chain
from trigpoint.methods import LocalKalman, design
from trigpoint.model import LinearAgent, NetworkedAgents
from trigpoint.model.documents import problem_document, read_problem
from trigpoint.observers import LocalObserver, NetworkObserver
from trigpoint.observers.documents import observer_document, read_observer

from .drawn import everything, exchange, observers

JUNK = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False) | st.text(max_size=4),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=4), inner, max_size=3),
    max_leaves=6,
)


def through_text(document):
    return json.loads(json.dumps(document, allow_nan=False))


def paths(document, prefix=()):
    """Every place in a JSON document."""
    yield prefix
    if isinstance(document, dict | list):
        for key in document if isinstance(document, dict) else range(len(document)):
            yield from paths(document[key], (*prefix, key))


def with_replaced(document, path, value):
    changed = copy.deepcopy(document)
    if not path:
        return value
    place = changed
    for key in path[:-1]:
        place = place[key]
    place[path[-1]] = value
    return changed


def without(document, path):
    changed = copy.deepcopy(document)
    place = changed
    for key in path[:-1]:
        place = place[key]
    del place[path[-1]]
    return changed


NODE_FILE = through_text(everything().local(3).to_document())
OBSERVER_FILE = through_text(observer_document(design(NetworkedAgents(chain(3), LinearAgent.static(2)), LocalKalman())))


# -- node files --------------------------------------------------------------------------------------------------------
@settings(max_examples=20)
@given(observers(), st.integers(0, 99))
def test_a_node_file_is_the_whole_program(observer, seed) -> None:
    states, messages, readings = exchange(observer, np.random.default_rng(seed))
    for node, name in enumerate(observer.graph.names):
        local = observer.local(node)
        document = through_text(local.to_document())
        again = LocalObserver.from_document(document)
        assert through_text(again.to_document()) == document
        assert (again.name, again.hears, again.n_states) == (local.name, local.hears, local.n_states)
        one = local.step(states[name], messages, readings, 0.3, np.ones(observer.agent.n_inputs))
        other = again.step(states[name], messages, readings, 0.3, np.ones(observer.agent.n_inputs))
        assert np.array_equal(one.estimate, other.estimate)


def test_a_node_file_knows_its_own_arcs_only() -> None:
    document = through_text(everything().local(0).to_document())
    assert [arc["label"] for arc in document["arcs"]] == [0, 1, 6]
    assert [arc["neighbour"] for arc in document["arcs"]] == ["b", "b", "c d"]
    assert "\u00fc" not in json.dumps(document, ensure_ascii=False)


@pytest.mark.parametrize(
    ("path", "value", "words"),
    [
        ((), None, "no node file"),
        ((), [], "no node file"),
        (("kind",), "trigpoint/problem", "no node file"),
        (("version",), 3, "version 3 is unknown; this reads 2"),
        (("version",), "1", "version '1' is unknown"),
        (("name",), 7, "'name'"),
        (("arcs",), {}, "list 'arcs'"),
        (("arcs", 0), 5, r"arcs\[0\] must be an object"),
        (("arcs", 0, "label"), 1.5, r"arcs\[0\] needs a whole number or null 'label'"),
        (("arcs", 0, "label"), True, r"arcs\[0\] needs a whole number or null 'label'"),
        (("arcs", 1, "neighbour"), 3, r"arcs\[1\] needs .*'neighbour'"),
        (("arcs", 0, "sign"), 0.5, "'sign' of 1 or -1"),
        (("arcs", 0, "sign"), None, "'sign' of 1 or -1"),
        (("arcs", 0, "gain"), None, "gain must be an object"),
        (("arcs", 0, "gain"), encode_array(np.zeros((2, 2))), r"gain must have shape \(3, any\); got \(2, 2\)"),
        (("arcs", 0, "output"), encode_array(np.zeros((2, 4))), r"output must have shape \(2, 3\); got \(2, 4\)"),
        (("arcs", 0, "neighbour_output"), None, "neighbour_output must be an object"),
        (
            ("arcs", 0, "neighbour_output"),
            encode_array(np.zeros((1, 3))),
            r"neighbour_output must have shape \(2, any\)",
        ),
        (("A",), encode_array(np.zeros((3, 2))), r"A must be square with at least one row; got \(3, 2\)"),
        (("A",), encode_array(np.zeros((0, 0))), "A must be square with at least one row"),
        (("A",), encode_array(np.zeros(3)), "A must be a matrix"),
        (("A", "type"), "f4", "A has type 'f4'"),
        (("A", "shape"), [3, 4], "A holds 72 bytes"),
        (("A", "shape"), "3x3", "expected a list of whole numbers"),
        (("A", "base64"), "!!!", "A is not base64"),
        (("B",), encode_array(np.zeros((2, 2))), r"B must have shape \(3, any\); got \(2, 2\)"),
        (("B",), 3, "B must be an object"),
        (("arcs", 0, "more"), {}, "'more' must be a list of pairs"),
        (("arcs", 0, "more"), [["b"]], "'more' must be a list of pairs"),
        (("arcs", 0, "more"), [[3, encode_array(np.zeros((2, 2)))]], "'more' must pair names with matrices"),
        (("arcs", 0, "more"), [["b", encode_array(np.zeros((1, 2)))]], r"more must have shape \(2, any\)"),
        (("readout",), encode_array(np.zeros((2, 2))), r"readout must have shape \(any, 3\)"),
        (("feedthrough",), None, "'feedthrough' must be a list of pairs"),
        (("feedthrough",), [["0", encode_array(np.zeros((3, 2)))]], "'feedthrough' must pair labels with matrices"),
        (("feedthrough",), [[0, encode_array(np.zeros((2, 2)))]], r"feedthrough must have shape \(3, any\)"),
        (("exchange",), "sometimes", "exchange must be one of held, euler"),
        (("acceleration",), 1.5, "acceleration must be null or a number between 0 and 1"),
    ],
)
def test_malformed_node_files_are_named(path, value, words) -> None:
    with pytest.raises(ProtocolError, match=words):
        LocalObserver.from_document(with_replaced(NODE_FILE, path, value))


def test_numbers_that_are_not_finite_are_refused() -> None:
    bad = encode_array(np.array([[np.nan, 0, 0]] * 3))
    with pytest.raises(ProtocolError, match="A must be finite; got nan"):
        LocalObserver.from_document(with_replaced(NODE_FILE, ("A",), bad))


@pytest.mark.parametrize("key", ["kind", "version", "name", "A", "arcs"])
def test_missing_fields_are_refused(key) -> None:
    with pytest.raises(ProtocolError):
        LocalObserver.from_document(without(NODE_FILE, (key,)))


@pytest.mark.parametrize("key", ["label", "sign", "gain", "output", "neighbour_output"])
def test_missing_fields_of_an_arc_are_refused(key) -> None:
    with pytest.raises(ProtocolError):
        LocalObserver.from_document(without(NODE_FILE, ("arcs", 0, key)))


@settings(max_examples=200)
@given(st.sampled_from(list(paths(NODE_FILE))), JUNK)
def test_no_change_of_a_node_file_escapes_as_another_error(path, value) -> None:
    try:
        local = LocalObserver.from_document(with_replaced(NODE_FILE, path, value))
    except ProtocolError:
        return
    state = local.step(local.init(), {}, {}, 0.1)
    assert np.isfinite(state.estimate).all(), "what is accepted also runs"


# -- problems and observers --------------------------------------------------------------------------------------------
@settings(max_examples=20)
@given(observers())
def test_observer_documents_come_back(observer) -> None:
    document = through_text(observer_document(observer))
    again = read_observer(document)
    assert through_text(observer_document(again)) == document
    assert np.array_equal(again.error_matrix().toarray(), observer.error_matrix().toarray())
    assert np.array_equal(again.reading_matrix().toarray(), observer.reading_matrix().toarray())
    assert again.graph.names == observer.graph.names
    assert (again.method, again.gain, again.decay_rate) == (observer.method, observer.gain, observer.decay_rate)
    for one, other in zip(again.problem.agents, observer.problem.agents, strict=True):
        assert np.array_equal(one.B, other.B)


def test_a_designed_observer_comes_back_with_its_numbers() -> None:
    agent = LinearAgent([[0, 1], [0, 0]], [[1, 0]], E=[[0.0], [1.0]])
    observer = design(NetworkedAgents(chain(4), agent), LocalKalman(process=np.eye(2)))
    again = read_observer(through_text(observer_document(observer)))
    assert again.decay_rate == observer.decay_rate
    assert again.spectral_abscissa == observer.spectral_abscissa
    assert again.facts["gain_rule"] == observer.facts["gain_rule"]
    assert np.array_equal(again.problem.agent.E, agent.E)
    assert again.local(3).to_document() == observer.local(3).to_document()


def test_problem_documents_write_equal_agents_once() -> None:
    agent, other = LinearAgent(-1.0, 1.0), LinearAgent(-1.0, 1.0, B=2.0)
    document = through_text(problem_document(NetworkedAgents(chain(3), [agent, other, agent])))
    assert len(document["agents"]) == 2
    again = read_problem(document)
    assert [None if a.B is None else a.B.item() for a in again.agents] == [None, 2.0, None]


@pytest.mark.parametrize(
    ("path", "value", "words"),
    [
        ((), [], "an observer document is an object; got list"),
        (("kind",), "x", "expected kind 'trigpoint/observer'"),
        (("version",), 9, "version 1"),
        (("form",), "dense", "form 'diffusive'"),
        (
            ("injection",),
            encode_array(np.zeros((1, 2))),
            r"injection must have shape \(n, p\) = \(2, 2\); got \(1, 2\)",
        ),
        (("gain",), 0, "gain must be a positive number"),
        (("gain",), True, "gain must be a positive number"),
        (("gain",), "1", "gain must be a positive number"),
        (("gain",), 10**400, "gain must be a positive number"),
        (("decay_rate",), None, "decay_rate a number"),
        (("spectral_abscissa",), "fast", "spectral_abscissa must be a number or null; got 'fast'"),
        (("method",), 5, "method must be a text; got 5"),
        (("facts",), 5, "does not fit"),
        (("problem",), 5, "does not fit"),
        (("problem", "graph", "head"), encode_array(np.array([0, 1, 9])), "does not fit"),
    ],
)
def test_malformed_observer_documents_are_named(path, value, words) -> None:
    with pytest.raises(ProtocolError, match=words):
        read_observer(with_replaced(OBSERVER_FILE, path, value))


@pytest.mark.parametrize("key", sorted(OBSERVER_FILE))
def test_missing_fields_of_an_observer_are_refused(key) -> None:
    with pytest.raises(ProtocolError):
        read_observer(without(OBSERVER_FILE, (key,)))


def test_an_observer_of_different_agents_is_refused() -> None:
    other = problem_document(NetworkedAgents(chain(3), [LinearAgent(-k * np.eye(2), np.eye(2)) for k in range(3)]))
    with pytest.raises(ProtocolError, match="the agents differ"):
        read_observer(with_replaced(OBSERVER_FILE, ("problem",), through_text(other)))


@settings(max_examples=200)
@given(st.sampled_from(list(paths(OBSERVER_FILE))), JUNK)
def test_no_change_of_an_observer_document_escapes_as_another_error(path, value) -> None:
    try:
        observer = read_observer(with_replaced(OBSERVER_FILE, path, value))
    except ProtocolError:
        return
    assert np.isfinite(observer.error_matrix().toarray()).all()


def test_other_observers_have_no_document_yet() -> None:
    class Other(NetworkObserver):
        names = error_matrix = local = general_form = verify_design_equations = None

    with pytest.raises(ProtocolError, match="no document form for Other"):
        observer_document(Other())
