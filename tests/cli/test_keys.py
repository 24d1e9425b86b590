"""``trigpoint keys``: names from a file or from options, what is written, what is refused."""

from __future__ import annotations

import stat

from tests.cli.shelled import GKF, NETWORK, json_of, refused, trigpoint


def test_the_nodes_of_a_file_and_the_guests_get_certificates(tmp_path) -> None:
    (tmp_path / "n.csv").write_text(NETWORK)
    folder = tmp_path / "keys"
    result = trigpoint("keys", tmp_path / "n.csv", "--out", folder, "--host", "10.0.0.1", "--days", 30)
    assert result.exit_code == 0
    assert "3 nodes; guests: plant (sensor), monitor (monitor), supervisor (supervisor)" in result.stdout
    names = {"a", "b", "c", "plant", "monitor", "supervisor", "authority"}
    assert {path.name for path in folder.iterdir()} == {f"{name}{end}" for name in names for end in (".pem", ".key")}
    assert {stat.S_IMODE(path.stat().st_mode) for path in folder.glob("*.key")} == {0o600}


def test_known_marks_run_no_process(tmp_path) -> None:
    (tmp_path / "n.gkf").write_text(GKF)
    document = json_of(trigpoint("keys", tmp_path / "n.gkf", "--out", tmp_path / "keys", "--json"))
    assert list(document["nodes"]) == ["B"]


def test_a_newcomer_joins_by_name(tmp_path) -> None:
    folder = tmp_path / "keys"
    first = json_of(trigpoint("keys", "--name", "a", "--guest", "log=monitor", "--out", folder, "--json"))
    assert first["guests"]["log"]["role"] == "monitor"
    authority = (folder / "authority.pem").read_bytes()
    second = json_of(trigpoint("keys", "--name", "b c", "--out", folder, "--json"))
    assert second == {
        "folder": str(folder),
        "authority": str(folder / "authority.pem"),
        "nodes": {"b c": {"certificate": str(folder / "b%20c.pem"), "key": str(folder / "b%20c.key")}},
        "guests": {},
        "days": 365,
    }
    assert (folder / "authority.pem").read_bytes() == authority
    refused(trigpoint("keys", "--name", "a", "--out", folder), "holds keys of 'a' already", "--overwrite", "--out")
    assert trigpoint("keys", "--name", "a", "--out", folder, "--overwrite").exit_code == 0
    assert (folder / "authority.pem").read_bytes() != authority


def test_misuse_is_refused(tmp_path) -> None:
    (tmp_path / "n.csv").write_text(NETWORK)
    folder = tmp_path / "keys"
    refused(trigpoint("keys", "--out", folder), "name the nodes either by")
    refused(trigpoint("keys", tmp_path / "n.csv", "--name", "a", "--out", folder), "name the nodes either by")
    refused(trigpoint("keys", "--name", "a", "--guest", "m=king", "--out", folder), "NAME=ROLE", "'m=king'")
    refused(trigpoint("keys", "--name", "a", "--guest", "monitor", "--out", folder), "NAME=ROLE")
    twice = ("--guest", "m=monitor", "--guest", "m=sensor")
    refused(trigpoint("keys", "--name", "a", *twice, "--out", folder), "somebody twice")
    refused(trigpoint("keys", "--name", "plant", "--out", folder), "'plant' is given twice")
    assert not folder.exists()
