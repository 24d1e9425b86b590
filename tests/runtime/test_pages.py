"""The reference page of the protocol says what the code does: its tables are compared with ours."""

from __future__ import annotations

import re
from pathlib import Path

from trigpoint.runtime import FACTS, LINK_FIELDS, REASONS, STATUS_FIELDS, TABLE, Event, Kind, State, topics
from trigpoint.runtime.codec import LARGEST_FRAME

PAGE = (Path(__file__).resolve().parents[2] / "docs" / "reference" / "protocol.md").read_text(encoding="utf-8")


def rows(heading: str) -> list[list[str]]:
    """Rows of all tables under a heading, without the marks."""
    part = PAGE.split(f"\n## {heading}\n")[1].split("\n## ")[0]
    lines = [line for line in part.splitlines() if line.startswith("|") and not line.startswith("|---")]
    return [[cell.strip().replace("`", "") for cell in line.strip("|").split("|")] for line in lines]


def test_the_table_of_states_is_the_one_at_work() -> None:
    head, *body = rows("One neighbour")
    assert head[1:] == [event.name for event in Event]
    written = {
        (State[row[0]], Event[name]): State[cell] for row in body for name, cell in zip(head[1:], row[1:], strict=True)
    }
    assert written == dict(TABLE)


def test_kinds_and_facts() -> None:
    body = [row for row in rows("Frames") if row[0] in Kind.__members__]
    assert {row[0]: int(row[1]) for row in body} == {kind.name: int(kind) for kind in Kind}
    assert {row[0]: tuple(filter(None, row[2].split(", "))) for row in body} == {k.name: f for k, f in FACTS.items()}


def test_reasons_and_status_fields() -> None:
    assert tuple(row[0] for row in rows("What is dropped")[1:]) == REASONS
    fields = [row[0] for row in rows("Status") if row[0] != "field"]
    assert tuple(fields) == (*STATUS_FIELDS, *LINK_FIELDS)


def test_keys_and_limits() -> None:
    written = [row[0] for row in rows("Keys")[1:]]
    assert written == re.findall(r"``(trigpoint/NET/\S+)``", topics.__doc__ or "")
    assert ["bytes of a frame", str(LARGEST_FRAME)] in rows("Limits")
