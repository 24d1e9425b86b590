"""Loading, saving and writing whole files."""

from __future__ import annotations

import os
import stat
from dataclasses import FrozenInstanceError

import pytest

from tests.io.drawn import assert_same
from trigpoint.errors import ArgumentError, FileFormatError, ProtocolError
from trigpoint.graphs import EXTERNAL, MeasurementGraph
from trigpoint.io import DOCUMENT_WRITERS, DOCUMENTS, FORMATS, load, save, text, write_atomically
from trigpoint.io.formats import NETWORK_FORMATS
from trigpoint.model import Network

NETWORK = Network(
    MeasurementGraph(3, [0, 1, EXTERNAL], [1, 2, 0], None, ["a", "b", "c"]),
    [1.0, 2.0, 3.0],
    [0.25, 0.25, 0.0],
    exact=[False, False, True],
    known=[0],
    unit="m",
)
SUFFIXES = [suffix for known in NETWORK_FORMATS.values() for suffix in known.suffixes]


@pytest.mark.parametrize("suffix", [*SUFFIXES, ".CSV"])
def test_every_format_gives_a_network_back(tmp_path, suffix):
    path = tmp_path / f"net{suffix}"
    save(NETWORK, path)
    assert_same(load(path), NETWORK)
    assert [entry.name for entry in tmp_path.iterdir()] == [path.name]


def test_formats_are_frozen_and_named_by_their_key():
    for name, known in FORMATS.items():
        assert known.name == name
        assert known.text
        with pytest.raises(FrozenInstanceError):
            known.name = "x"
    assert {"csv", "tsv", "gkf", "xml", "graphml", "json", "toml"} <= set(FORMATS)


def test_xml_is_read_as_what_it_is(tmp_path):
    save(NETWORK, tmp_path / "a.graphml")
    (tmp_path / "a.graphml").rename(tmp_path / "a.xml")
    assert_same(load(tmp_path / "a.xml"), NETWORK)


@pytest.mark.parametrize("suffix", [".csv", ".gkf", ".xml", ".graphml", ".json", ".toml"])
def test_a_missing_file_a_folder_and_nonsense_are_errors_of_the_file(tmp_path, suffix):
    path = tmp_path / f"a{suffix}"
    with pytest.raises(FileFormatError, match="no such file"):
        load(path)
    path.write_bytes(b"\x00\xff\x01 nonsense")
    with pytest.raises(FileFormatError) as caught:
        load(path)
    assert str(caught.value).startswith(str(path))
    path.unlink()
    path.mkdir()
    with pytest.raises(FileFormatError, match="folder"):
        load(path)


@pytest.mark.parametrize("call", [load, lambda path: save(NETWORK, path)])
@pytest.mark.parametrize(
    ("name", "words"), [("a.cvs", "'.cvs' .csv .toml did you mean"), ("a", "without a suffix .json")]
)
def test_an_unknown_suffix_lists_the_known_ones(call, name, words):
    with pytest.raises(FileFormatError) as caught:
        call(name)
    for word in words.split():
        assert word in str(caught.value)


def test_an_unreadable_file_is_an_error_of_the_file():
    with pytest.raises(FileFormatError, match="cannot be read"):
        load("a\0b.csv")
    with pytest.raises(FileFormatError, match="cannot be read"):
        load("a" * 5000 + ".csv")


def test_what_cannot_be_saved_is_refused_before_anything_is_written(tmp_path):
    for data, suffix, word in (
        (NETWORK.graph, ".csv", "without measured values"),
        ("text", ".csv", "got a str"),
        ("text", ".json", "got a str"),
        (NETWORK, ".toml", "by hand"),
    ):
        with pytest.raises(ArgumentError, match=word):
            save(data, tmp_path / f"a{suffix}")
    assert not list(tmp_path.iterdir())


def test_own_documents_go_through_the_hooks(tmp_path, monkeypatch):
    class Thing:
        pass

    def refuse(document):
        raise ProtocolError("no such version")

    monkeypatch.setitem(DOCUMENTS, "trigpoint/thing", lambda document: document["n"])
    monkeypatch.setitem(DOCUMENTS, "trigpoint/bad", refuse)
    monkeypatch.setitem(DOCUMENT_WRITERS, Thing, lambda _: '{"kind": "trigpoint/thing", "n": 5}')
    save(Thing(), tmp_path / "a.json")
    assert load(tmp_path / "a.json") == 5
    (tmp_path / "b.json").write_text('{"kind": "trigpoint/bad"}')
    with pytest.raises(FileFormatError, match="no such version"):
        load(tmp_path / "b.json")
    (tmp_path / "c.json").write_text('{"kind": "trigpoint/thng"}')
    with pytest.raises(FileFormatError, match="did you mean 'trigpoint/thing'"):
        load(tmp_path / "c.json")


def test_a_failed_write_leaves_the_old_file_and_nothing_else(tmp_path, monkeypatch):
    path = tmp_path / "a.txt"
    write_atomically(path, "old")

    def fail(*args):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "replace", fail)
    with pytest.raises(FileFormatError, match="No space left"):
        write_atomically(path, "new")
    assert path.read_text() == "old"
    assert [entry.name for entry in tmp_path.iterdir()] == ["a.txt"]


def test_places_that_cannot_be_written(tmp_path):
    with pytest.raises(FileFormatError, match="folder"):
        write_atomically(tmp_path, "x")
    with pytest.raises(FileFormatError, match="create it"):
        write_atomically(tmp_path / "no" / "a.txt", "x")
    with pytest.raises(FileFormatError, match="cannot be written"):
        write_atomically(tmp_path / "a.txt", "\ud800")
    assert not list(tmp_path.iterdir())


def test_links_are_followed_modes_are_kept_and_bytes_are_bytes(tmp_path):
    target, link = tmp_path / "a.txt", tmp_path / "link.txt"
    write_atomically(target, b"\x00\xff")
    assert target.read_bytes() == b"\x00\xff"
    target.chmod(0o640)
    link.symlink_to(target)
    write_atomically(link, "ü\n")
    assert link.is_symlink()
    assert target.read_bytes() == "ü\n".encode()
    assert stat.S_IMODE(target.stat().st_mode) == 0o640
    write_atomically(os.devnull, "gone")
    assert not os.path.isfile(os.devnull)


def test_an_oversized_file_is_refused_before_it_is_read(tmp_path, monkeypatch) -> None:
    monkeypatch.setattr(text, "LARGEST_FILE", 100)
    path = tmp_path / "certificate.json"
    path.write_text("{" + " " * 200 + "}", encoding="utf-8")
    with pytest.raises(FileFormatError, match="got 202 bytes; files of at most 100 bytes are read"):
        load(path)
