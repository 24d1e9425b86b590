"""``verify`` against everything that may happen to the three files."""

from __future__ import annotations

import copy
import json
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.cli.shelled import SCENARIO, json_of, refused, trigpoint, written
from trigpoint.arrays import digest_of, encode_array
from trigpoint.certificates import CLAIMS
from trigpoint.cli.designing import _beside
from trigpoint.errors import FileFormatError
from trigpoint.io import text
from trigpoint.model import NetworkedAgents

DOCUMENTS = ("certificate.json", "problem.json", "observer.json")


@pytest.fixture(scope="module")
def designed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("designed")
    scenario = written(folder, "s.toml", SCENARIO)
    assert trigpoint("design", scenario, "--certify", "--out", folder / "design").exit_code == 0
    return folder / "design"


@pytest.fixture
def folder(designed: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(designed, tmp_path / "design"))


def leaves(value: Any, at: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    entries = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else None
    if entries is None:
        yield at
    else:
        for key, entry in entries:
            yield from leaves(entry, (*at, key))


def with_leaf(document: Any, at: tuple[Any, ...], change: Any) -> Any:
    changed = copy.deepcopy(document)
    owner = changed
    for key in at[:-1]:
        owner = owner[key]
    owner[at[-1]] = change(owner[at[-1]])
    return changed


def other(value: Any) -> Any:
    if isinstance(value, str):
        return ("B" if value[:1] != "B" else "C") + value[1:]
    return 1 if value is None else value + 1


def check(folder: Path) -> Any:
    return trigpoint("verify", folder / "certificate.json")


@pytest.mark.parametrize("name", DOCUMENTS)
def test_any_changed_field_is_refused(folder: Path, name: str) -> None:
    document = json.loads((folder / name).read_text(encoding="utf-8"))
    places = list(leaves(document))
    assert len(places) > 8
    for at in places:
        (folder / name).write_text(json.dumps(with_leaf(document, at, other)), encoding="utf-8")
        refused(check(folder))


@pytest.mark.parametrize("name", DOCUMENTS)
def test_any_removed_or_added_field_is_refused(folder: Path, name: str) -> None:
    document = json.loads((folder / name).read_text(encoding="utf-8"))
    for key in document:
        less = {k: v for k, v in document.items() if k != key}
        (folder / name).write_text(json.dumps(less), encoding="utf-8")
        result = check(folder)
        assert result.exit_code == 2, key
    (folder / name).write_text(json.dumps({**document, "note": "harmless"}), encoding="utf-8")
    refused(check(folder), name)


@pytest.mark.parametrize("name", DOCUMENTS)
def test_any_changed_byte_is_refused(folder: Path, name: str) -> None:
    data = (folder / name).read_bytes()
    rng = np.random.default_rng(DOCUMENTS.index(name))
    positions = [k for k in rng.permutation(len(data)).tolist() if not data[k : k + 1].isspace()][:60]
    for position in positions:
        damaged = bytearray(data)
        damaged[position] ^= 1 << int(rng.integers(0, 7))
        (folder / name).write_bytes(bytes(damaged))
        refused(check(folder))
    (folder / name).write_bytes(data)
    assert check(folder).exit_code == 0


@pytest.mark.parametrize("name", DOCUMENTS)
@pytest.mark.parametrize("content", ["", "{}", "[]", "null", "1e999", '{"kind": 1e999}', "[" * 100_000])
def test_another_content_is_refused(folder: Path, name: str, content: str) -> None:
    written(folder, name, content)
    refused(check(folder), name)


@pytest.mark.parametrize("name", DOCUMENTS)
def test_a_missing_document_is_named(folder: Path, name: str) -> None:
    (folder / name).unlink()
    refused(check(folder), name)


def test_documents_that_change_places_are_refused(folder: Path) -> None:
    shutil.copy(folder / "observer.json", folder / "problem.json")
    refused(check(folder), "problem.json")
    refused(trigpoint("verify", folder / "observer.json"), "expected a certificate")
    refused(trigpoint("certify", folder / "certificate.json"), "expected an observer")


def resealed(folder: Path, change: Any) -> None:
    path = folder / "certificate.json"
    document = json.loads(path.read_text(encoding="utf-8"))
    change(document)
    body = {key: value for key, value in document.items() if key != "digest"}
    path.write_text(json.dumps({**body, "digest": digest_of(body)}), encoding="utf-8")


def claim(document: Any, name: str) -> Any:
    return next(entry for entry in document["claims"] if entry["claim"] == name)


def faster(document: Any) -> None:
    claim(document, "convergence")["numbers"]["rate"] *= 1.01


def higher_floor(document: Any) -> None:
    claim(document, "convergence")["numbers"]["lambda_floor"] *= 1.01


def higher_bound(document: Any) -> None:
    claim(document, "smallest-eigenvalue")["numbers"]["lower"] *= 1.01


def lower_bound(document: Any) -> None:
    claim(document, "smallest-eigenvalue")["numbers"]["upper"] *= 0.99


def indefinite(document: Any) -> None:
    claim(document, "convergence")["witness"]["P"] = encode_array(-np.eye(2))


def misshapen(document: Any) -> None:
    claim(document, "convergence")["witness"]["P"] = encode_array(np.eye(3))


def missing(document: Any) -> None:
    del claim(document, "convergence")["witness"]["P"]


def numberless(document: Any) -> None:
    del claim(document, "convergence")["numbers"]["rate"]


def renamed(document: Any) -> None:
    claim(document, "convergence")["claim"] = "instant-convergence"


def newer(document: Any) -> None:
    document["version"] = 2


def huge(document: Any) -> None:
    claim(document, "convergence")["numbers"]["rate"] = 10**400


def relabelled(document: Any) -> None:
    claim(document, "locality")["verdict"] = "refuted"


def claimless(document: Any) -> None:
    document["claims"] = []


def strange(document: Any) -> None:
    document["problem"] = "0" * 64


@pytest.mark.parametrize(
    ("forge", "verdict"),
    [
        (faster, "inconclusive"),
        (higher_floor, "inconclusive"),
        (higher_bound, "refuted"),
        (lower_bound, "refuted"),
        (indefinite, "inconclusive"),
    ],
)
def test_a_forgery_with_a_right_digest_and_false_numbers_is_not_believed(
    folder: Path, forge: Any, verdict: str
) -> None:
    resealed(folder, forge)
    result = trigpoint("verify", folder / "certificate.json", "--json")
    assert result.exit_code == {"refuted": 1, "inconclusive": 3}[verdict]
    assert json_of(result)["verdict"] == verdict


@pytest.mark.parametrize("name", DOCUMENTS)
def test_a_truncated_file_is_refused(folder: Path, name: str) -> None:
    data = (folder / name).read_bytes()
    for share in (0.0, 0.1, 0.5, 0.9, 0.999):
        (folder / name).write_bytes(data[: int(share * len(data.rstrip()))])
        refused(check(folder), name)


@pytest.mark.parametrize("name", DOCUMENTS)
def test_an_oversized_file_is_refused_before_it_is_read(
    folder: Path, name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    size = (folder / name).stat().st_size
    monkeypatch.setattr(text, "LARGEST_FILE", 10 * size)
    with (folder / name).open("ab") as stream:
        stream.write(b" " * 10 * size)
    refused(check(folder), name, f"at most {10 * size} bytes")


@pytest.mark.parametrize("value", ["NaN", "Infinity", "-Infinity", "1e999"])
def test_a_number_that_is_none_is_refused(folder: Path, value: str) -> None:
    data = (folder / "certificate.json").read_text(encoding="utf-8")
    rate = repr(claim(json.loads(data), "convergence")["numbers"]["rate"])
    assert rate in data
    written(folder, "certificate.json", data.replace(rate, value))
    refused(check(folder), "certificate.json")


def test_every_claim_has_an_option(folder: Path) -> None:
    options = ("--rate", 0.01, "--period", 0.01, "--delay", 0.001, "--max-nodes", 8, "--mu", 0.1, "--observable")
    result = trigpoint("certify", folder / "observer.json", *options, "--json")
    stated = [entry["claim"] for entry in json_of(result)["claims"]]
    more = (
        "--arrival",
        0.9,
        "--period",
        0.01,
        "--floor",
        0.5,
        "--ceiling",
        2.0,
        "--process",
        0.1,
        "--measurement",
        0.2,
    )
    result = trigpoint("certify", folder / "observer.json", *more, "--json")
    further = {entry["claim"]: entry["numbers"] for entry in json_of(result)["claims"]}
    assert {*stated, *further} == {kind.name for kind in CLAIMS}
    assert len(stated) == len(set(stated))
    assert (further["switching-stability"]["floor"], further["switching-stability"]["ceiling"]) == (0.5, 2.0)
    assert (further["covariance-bound"]["process"], further["covariance-bound"]["measurement"]) == (0.1, 0.2)
    refused(trigpoint("certify", folder / "observer.json", "--arrival", 0.9), "--arrival needs --period")


def test_options_that_state_several_claims_and_those_that_share_one(folder: Path) -> None:
    """A family beside an interval, a period beside a loss; one bound where levels are given in two ways."""
    options = ("--max-nodes", 8, "--floor", 0.5, "--ceiling", 2.0, "--mu", 0.1, "--process", 0.3)
    result = trigpoint("certify", folder / "observer.json", *options, "--period", 0.01, "--arrival", 0.9, "--json")
    claims = [(entry["claim"], entry["numbers"]) for entry in json_of(result)["claims"]]
    families = [numbers["max_nodes"] for name, numbers in claims if name == "switching-stability"]
    assert families == [8, 0]
    levels = [(numbers["process"], numbers["measurement"]) for name, numbers in claims if name == "covariance-bound"]
    assert levels == [(0.3, 0.1)]
    names = [name for name, _ in claims]
    assert {"sampled-stability", "mean-square-stability"} <= set(names)


@pytest.mark.parametrize(
    ("option", "value", "expected"),
    [
        *(
            (option, value, "a positive number")
            for option in ("--period", "--floor")
            for value in ("nan", "inf", 0, -1)
        ),
        ("--rate", "nan", "a number"),
        ("--rate", "inf", "a number"),
        ("--max-nodes", 0, "a whole number, 1 or more"),
        ("--delay", -1, "seconds, 0 or more"),
        ("--mu", "nan", "a noise level, 0 or more"),
        ("--process", -0.5, "a noise level, 0 or more"),
        ("--measurement", "inf", "a noise level, 0 or more"),
        ("--arrival", 1.5, "a probability above 0, at most 1"),
        ("--arrival", 0, "a positive number"),
    ],
)
def test_numbers_out_of_range_are_no_claims(folder: Path, option: str, value: Any, expected: str) -> None:
    refused(trigpoint("certify", folder / "observer.json", f"{option}={value}"), f"{option}: got", expected)


@pytest.mark.parametrize(
    "forge", [misshapen, missing, numberless, renamed, newer, huge, relabelled, claimless, strange]
)
def test_a_forgery_with_a_right_digest_and_a_wrong_form_is_refused(folder: Path, forge: Any) -> None:
    resealed(folder, forge)
    refused(check(folder))


def test_a_certificate_that_names_a_foreign_document_as_its_problem_is_refused(folder: Path, designed: Path) -> None:
    """The digest fits, but what stands there is no problem, or no observer."""
    links = {"nodes": [{"id": "a"}, {"id": ""}], "links": [{"source": "", "target": "a"}]}
    for what in ("problem", "observer"):
        (folder / f"{what}.json").write_text(json.dumps(links), encoding="utf-8")
        resealed(folder, lambda document, what=what: document.update({what: digest_of(links)}))
        refused(check(folder), f"{what}.json")
        shutil.copytree(designed, folder, dirs_exist_ok=True)


def test_an_unanchored_network_is_refuted_whatever_its_certificate_says(tmp_path: Path, folder: Path) -> None:
    """The observer of an unanchored network, written by a forger: certify and verify answer refuted, exit code 1."""
    observer = json.loads((folder / "observer.json").read_text(encoding="utf-8"))
    graph = observer["problem"]["graph"]
    graph["tail"], graph["head"] = (encode_array(np.array(ends)) for ends in ([-1, 0], [0, 1]))
    (folder / "observer.json").write_text(json.dumps(observer), encoding="utf-8")
    (folder / "problem.json").write_text(json.dumps(observer["problem"]), encoding="utf-8")
    made = trigpoint("certify", folder / "observer.json", "--json", "--out", folder / "certificate.json")
    assert made.exit_code == 1
    assert json_of(made)["verdict"] == "refuted"

    def whitewashed(document: Any) -> None:
        document["verdict"] = "certified"
        for entry in document["claims"]:
            entry["verdict"] = "certified"

    assert check(folder).exit_code == 1
    resealed(folder, whitewashed)
    result = trigpoint("verify", folder / "certificate.json", "--json")
    assert result.exit_code == 1
    assert json_of(result)["verdict"] == "refuted"


def test_claims_on_request(folder: Path) -> None:
    observer, target = folder / "observer.json", folder / "asked.json"
    asked = ("--period", "0.01", "--max-nodes", "9", "--mu", "0.1", "--delay", "0.001")
    made = trigpoint("certify", observer, *asked, "--json", "--out", target)
    claims = {claim["claim"]: claim["verdict"] for claim in json.loads(made.stdout)["claims"]}
    assert {"switching-stability", "sampled-stability", "delay-margin", "noise-budget"} < set(claims)
    again = json.loads(trigpoint("verify", target, "--json").stdout)
    assert {claim["claim"]: claim["verdict"] for claim in again["claims"]} == claims
    refused(trigpoint("certify", observer, "--arrival", "0.5"), "--arrival needs --period")
    lossy = trigpoint("certify", observer, "--arrival", "0.9", "--period", "0.01", "--json")
    assert "mean-square-stability" in lossy.stdout


def test_a_problem_nested_as_deep_as_can_be_read_is_refused_like_any_other(folder: Path) -> None:
    """What is read at the edge of the recursion limit may be too deep for the second look, and for its digest."""
    path = folder / "problem.json"
    plain = path.read_text().rstrip()
    digest = json.loads((folder / "certificate.json").read_text())["problem"]
    for depth in range(800, 1000):
        path.write_text(plain[:-1] + ', "extra": ' + '{"a":' * depth + "0" + "}" * depth + "}")
        with pytest.raises(FileFormatError):
            _beside(folder / "certificate.json", "problem", digest, (NetworkedAgents,))
