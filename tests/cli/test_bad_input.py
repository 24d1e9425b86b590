"""Every broken file: exit code 2, one line with file and line, nothing written."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.cli.shelled import FLOATING, GKF, MAIN, NETWORK, SCENARIO, json_of, process, refused, trigpoint, written

HEAD = "from,to,value,sigma\n,a,1,\n"
ENTITY = '<?xml version="1.0"?>\n<!DOCTYPE gama-local [<!ENTITY x SYSTEM "file:///etc/passwd">]>\n<gama-local/>'

BROKEN_TABLES = {
    "missing column": ("from,value\na,1\n", 1, "no column 'to'"),
    "no header": ("a,b,1\nb,c,2\n", 1, "the first line must be from,to,value[,sigma]"),
    "row longer than the header": (HEAD + "a,b,1,1,1\n", 3, "got 5 fields, expected 4"),
    "row shorter than the header": (HEAD + "a,b,1\n", 3, "got 3 fields, expected 4"),
    "NaN": (HEAD + "a,b,nan,1\n", 3, "finite"),
    "infinity": (HEAD + "a,b,-inf,1\n", 3, "finite"),
    "infinity by overflow": (HEAD + "a,b,1e999,1\n", 3, "finite"),
    "text for a number": (HEAD + "a,b,one,1\n", 3, "'one'"),
    "decimal comma": (HEAD + 'a,b,"1,5",1\n', 3, "decimal point"),
    "nothing for a number": (HEAD + "a,b,,1\n", 3, "number"),
    "sigma zero": (HEAD + "a,b,1,0\n", 3, "sigma"),
    "negative sigma": (HEAD + "a,b,1,-2\n", 3, "sigma"),
    "sigma NaN": (HEAD + "a,b,1,nan\n", 3, "finite"),
    "sigma missing among others": (HEAD + "a,b,1,1\nb,c,1,\n", 4, "sigma"),
    "self-loop": (HEAD + "a,a,1,1\n", 3, "'a'"),
    "no destination": (HEAD + "a,,1,1\n", 3, "to"),
    "unclosed quote": (HEAD + 'a,"b,1,1\nb,c,1,1\n', 3, "quote"),
    "field over 1 MB": (HEAD + f"a,{'b' * 1_100_000},1,1\n", 3, "1 MB"),
    "no measurement": ("from,to,value,sigma\n", None, "no"),
    "empty": ("", None, "header"),
    "comments only": ("# nothing\n", None, "header"),
    "binary content": (b"from,to,value\n\x00\x01\x02", 2, "NUL"),
    "another encoding": (b"from,to,value\n,h\xf6he,1\n", 2, "UTF-8"),
    "a column twice": ("from,to,value,value\n", 1, "twice"),
    "an unknown directive": ("#@ konwn a\n" + HEAD, 1, "'known'"),
}

BROKEN_GAMA = {
    "not XML": ("from,to\n", 1, "well-formed XML"),
    "cut off": (GKF[:-20], None, "well-formed XML"),
    "an undeclared point": (GKF.replace('to="B"', 'to="C"'), 6, "'C'"),
    "a point declared twice": (GKF.replace('id="B" adj="z"', 'id="A" adj="z"'), 4, "'A'"),
    "an external entity": (ENTITY, 2, "DOCTYPE"),
    "another document": ("<html/>", 1, "gama-local"),
    "text for a number": (GKF.replace("1.5", "high"), 6, "'high'"),
    "NaN": (GKF.replace("1.5", "nan"), 6, "finite"),
    "a self-loop": (GKF.replace('to="B"', 'to="A"'), 6, "'A'"),
    "stdev zero": (GKF.replace('stdev="1.0"', 'stdev="0"'), 6, "stdev"),
    "another observation": (GKF.replace("<dh ", "<distance "), 6, "distance"),
    "binary": (b"\x00\x01", None, "XML"),
}

BROKEN_SCENARIOS = {
    "not TOML": ("[network\n", 1, "no TOML"),
    "an unknown key": (SCENARIO + '[design]\nmetod = "x"\n', 7, "did you mean 'method'?"),
    "an unknown table": (SCENARIO + "[simulat]\nseed = 1\n", 6, "did you mean 'simulate'?"),
    "an infinite number": (SCENARIO + "[simulate]\nhorizon = inf\n", 7, "finite"),
    "a loss above 1": (
        SCENARIO + "[simulate]\nloss = 2\n",
        7,
        "got 2, expected a number less than or equal to 1; correct it",
    ),
    "another word for n": ('[network]\ngallery = {kind = "complete", nodes = 3}\n', 2, "did you mean 'n'?"),
    "a fixed point elsewhere": (
        '[network]\narcs = [["", "A", 1.0]]\nfixed = {Q = 1}\n',
        3,
        "correct the name, or leave it out",
    ),
    "no network": ("[design]\n", None, "network"),
    "a missing arcs file": ('[network]\narcs = "none.csv"\n', 2, "none.csv"),
    "an unstackable agent": (SCENARIO.replace("C = [[1, 0]]", "C = [[1, 0, 0]]"), 5, "C"),
    "a ragged matrix": (SCENARIO.replace("A = [[0, 1], [0, 0]]", "A = [[0, 1], [0]]"), 4, "A"),
}

BROKEN_JSON = {
    "not JSON": ("{", 1, "no JSON"),
    "NaN": ('{"nodes": [],\n "links": [NaN]}', 2, "NaN"),
    "an unknown document": ('{"kind": "trigpoint/certificat"}', None, "trigpoint/certificate"),
    "a list": ("[]", None, "object"),
    "too deep": ("[" * 200_000, None, "json"),
    "a node twice": ('{"nodes": [{"id": 1}, {"id": "1"}], "links": []}', None, "twice"),
}

BROKEN = [
    pytest.param(f"broken.{suffix}", *entry, id=f"{suffix}: {name}")
    for suffix, table in (
        ("csv", BROKEN_TABLES),
        ("gkf", BROKEN_GAMA),
        ("toml", BROKEN_SCENARIOS),
        ("json", BROKEN_JSON),
    )
    for name, entry in table.items()
]


@pytest.mark.parametrize(("name", "content", "line", "word"), BROKEN)
def test_a_broken_file_is_one_error_line_and_leaves_nothing(
    tmp_path: Path, name: str, content: str | bytes, line: int | None, word: str
) -> None:
    path = written(tmp_path, name, content)
    where = f"{path}:{line}: " if line is not None else f"{path}:"
    out = tmp_path / "out"
    assert refused(trigpoint("estimate", path, "--out", out.with_suffix(".csv")), word).startswith(f"error: {where}")
    refused(trigpoint("check", path, "--json"), word)
    refused(trigpoint("design", path, "--certify", "--out", out), word)
    refused(trigpoint("convert", path, out.with_suffix(".json")), word)
    assert [found.name for found in tmp_path.iterdir()] == [name]


@pytest.mark.parametrize(
    "content",
    [
        NETWORK.replace("\n", "\r\n"),
        "\ufeff" + NETWORK,
        "\ufeff" + NETWORK.replace("\n", "\r\n") + "\r\n\r\n\r\n",
        NETWORK + "\n\n\n",
        NETWORK.rstrip("\n"),
        "# a comment\n" + NETWORK + "# another\n",
    ],
)
def test_line_endings_byte_order_marks_and_blank_lines_are_accepted(tmp_path: Path, content: str) -> None:
    plain = written(tmp_path, "plain.csv", NETWORK)
    other = written(tmp_path, "other.csv", content)
    assert trigpoint("estimate", other, "--json").stdout == trigpoint("estimate", plain, "--json").stdout


@pytest.mark.parametrize("name", ["s.toml", "n.gkf"])
def test_windows_files_of_other_formats_are_accepted(tmp_path: Path, name: str) -> None:
    content = SCENARIO if name.endswith("toml") else GKF
    path = written(tmp_path, name, "\ufeff" + content.replace("\n", "\r\n"))
    assert trigpoint("check", path).exit_code == 0


AWKWARD = ["[red]x[/red]", "[m]", "[/]", "[bold", ":smile:", "höhe 高", "a\\b", "%s{}", "L" * 300, "-", "\u202eback"]


def test_names_are_printed_as_they_are(tmp_path: Path) -> None:
    rows = "".join(f"[m],{name},0.5,1\n" for name in AWKWARD if name != "[m]")
    path = written(tmp_path, "n.csv", f"from,to,value,sigma\n,[m],1,\n{rows}")
    shown = trigpoint("estimate", path).stdout
    facts = json_of(trigpoint("estimate", path, "--json"))
    for name in AWKWARD:
        assert name in shown
        assert name in facts["estimates"]


def test_names_in_findings_and_errors_are_printed_as_they_are(tmp_path: Path) -> None:
    path = written(tmp_path, "n.csv", FLOATING.replace("c,d", "[red]c[/red],:d:"))
    for command in ("check", "estimate"):
        result = trigpoint(command, path)
        assert result.exit_code == 1
        assert "[red]c[/red]" in result.stdout
    assert "[red]c[/red]" in trigpoint("design", path).stderr
    loop = written(tmp_path, "loop.csv", HEAD + "[m],[m],1,1\n")
    refused(trigpoint("check", loop), "'[m]'")


def test_names_survive_a_terminal_that_lacks_their_letters(tmp_path: Path) -> None:
    written(tmp_path, "n.csv", "from,to,value,sigma\n,höhe,1,\nhöhe,高,1,1\n")
    shown = process("estimate", "n.csv", cwd=tmp_path, PYTHONIOENCODING="ascii")
    assert (shown.returncode, shown.stderr) == (0, "")
    assert r"h\xf6he" in shown.stdout
    script = process("estimate", "n.csv", "--json", cwd=tmp_path, PYTHONIOENCODING="ascii")
    assert script.returncode == 0
    assert r"h\u00f6he" in script.stdout


def test_out_in_a_folder_that_does_not_exist_is_refused(tmp_path: Path) -> None:
    network = written(tmp_path, "n.csv", NETWORK)
    missing = tmp_path / "missing"
    refused(trigpoint("estimate", network, "--out", missing / "a.csv"), "there is no folder", "missing")
    refused(trigpoint("convert", network, missing / "a.json"), "there is no folder")
    refused(trigpoint("simulate", network, "--out", missing / "a.html"), "there is no folder")
    refused(trigpoint("simulate", network, "--out", missing / "a.npz"), "there is no folder")
    assert not missing.exists()


def test_out_that_is_a_folder_or_a_file_in_its_way_is_refused(tmp_path: Path) -> None:
    network = written(tmp_path, "n.csv", NETWORK)
    (tmp_path / "folder.csv").mkdir()
    refused(trigpoint("estimate", network, "--out", tmp_path / "folder.csv"), "this is a folder")
    refused(trigpoint("convert", network, tmp_path / "folder.csv"), "this is a folder")
    refused(trigpoint("design", network, "--out", network), "n.csv")
    refused(trigpoint("demo", "--out", network), "n.csv")
    assert network.read_text(encoding="utf-8") == NETWORK
    assert list((tmp_path / "folder.csv").iterdir()) == []


def test_out_that_the_system_refuses_is_one_error_line(tmp_path: Path) -> None:
    network = written(tmp_path, "n.csv", NETWORK)
    device = Path("/dev/full")
    assert device.exists()
    refused(trigpoint("estimate", network, "--out", device), "cannot be written", "No space left")
    refused(trigpoint("estimate", network, "--out", tmp_path / ("x" * 300)), "File name too long")
    assert [path.name for path in tmp_path.iterdir()] == ["n.csv"]


def test_a_file_that_stands_there_is_replaced_whole(tmp_path: Path) -> None:
    network = written(tmp_path, "n.csv", NETWORK)
    out = written(tmp_path, "out.csv", "old " * 10_000)
    assert trigpoint("estimate", network, "--out", out).exit_code == 0
    assert "old" not in out.read_text(encoding="utf-8")
    broken = written(tmp_path, "broken.csv", HEAD + "a,b\n")
    before = out.read_bytes()
    refused(trigpoint("estimate", broken, "--out", out))
    assert out.read_bytes() == before


@pytest.mark.parametrize("command", [["estimate", "n.csv"], ["estimate", "n.csv", "--json"], ["reproduce"]])
def test_a_reader_that_left_is_no_error(tmp_path: Path, command: list[str]) -> None:
    written(tmp_path, "n.csv", NETWORK)
    read, write = os.pipe()
    os.close(read)
    try:
        done = subprocess.run(
            [sys.executable, "-c", MAIN, *command],
            stdout=write,
            stderr=subprocess.PIPE,
            cwd=tmp_path,
            check=False,
        )
    finally:
        os.close(write)
    assert (done.returncode, done.stderr) == (0, b"")


@pytest.mark.parametrize("name", ["none.csv", "none.toml", "none", "none.docx", "folder.csv"])
def test_what_is_no_readable_file_is_one_error_line(tmp_path: Path, name: str) -> None:
    (tmp_path / "folder.csv").mkdir()
    refused(trigpoint("check", f"{tmp_path}/{name}"))


def test_numbers_beyond_floating_point_are_one_error_line(tmp_path: Path) -> None:
    network = written(tmp_path, "n.csv", NETWORK)
    with pytest.warns(RuntimeWarning, match="overflow"):
        result = trigpoint("design", network, "--gain", "1e308")
    refused(result, "range of floating point")
