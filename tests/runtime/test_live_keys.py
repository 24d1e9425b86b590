"""The page on keys, frames and logs says what the code does; its lines of C and the small client read our frames."""

from __future__ import annotations

import json
import os
import re
import shutil
import struct
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from tests.runtime.given import case
from tests.runtime.links import address
from tests.runtime.logged import estimate, reading, truth
from trigpoint.runtime import (
    FACTS,
    LINK_FIELDS,
    STATUS_FIELDS,
    Frame,
    Kind,
    NodeMachine,
    Reading,
    ReadingPublisher,
    State,
    ZenohTransport,
    encode_frame,
)
from trigpoint.runtime.log_format import LABEL, LOG_KIND, LOG_VERSION, SCHEMAS
from trigpoint.runtime.topics import node_key, ping_key, reading_key, truth_key
from trigpoint.runtime.virtual import SENSOR

ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / "docs" / "reference" / "live-keys.md").read_text(encoding="utf-8")
CLIENT = ROOT / "examples" / "client" / "read_estimates.py"
NAMES = ["a", "", "µ/ %", "n" * 1024]


def listed(names: tuple[str, ...]) -> str:
    return ", ".join(f"`{name}`" for name in names)


def row(first: str) -> str:
    (found,) = [line for line in PAGE.splitlines() if line.startswith(f"| {first} |")]
    return found


def test_the_keys_are_those_of_the_page() -> None:
    keys = {node_key("NET", "NAME", channel) for channel in ("estimate", "status", "hello", "control")}
    keys |= {ping_key("NET", "NAME", "OTHER"), reading_key("NET", 7).replace("7", "LABEL"), truth_key("NET", "NAME")}
    assert {key.strip("`") for key in re.findall(r"^\| (`trigpoint/\S+`) \|", PAGE, re.MULTILINE)} == keys


def test_the_kinds_and_their_facts_are_those_of_the_page() -> None:
    for kind in Kind:
        assert row(kind.name).startswith(f"| {kind.name} | {int(kind)} | {listed(FACTS[kind]) or 'none'} |")


def test_the_fields_of_a_status_are_those_of_the_page() -> None:
    assert row("first") == f"| first | {listed(STATUS_FIELDS)} |"
    assert row("each link") == f"| each link | {listed(LINK_FIELDS)} |"
    assert ", ".join(f"{int(state)} {state.name.lower()}" for state in State) in PAGE


def test_the_head_of_a_frame_is_that_of_the_page() -> None:
    fields = re.findall(r"^\| (\d+) \| (\S+)(?: bytes)? \| (\w+) \|", PAGE, re.MULTILINE)
    frame = estimate("node", 77, 1.5, [2.0, 3.0], epoch=99)
    data = encode_frame(frame)
    expected = {"magic": b"TP", "version": 2, "kind": 3, "name_length": 4, "count": 2, "epoch": 99, "sequence": 77}
    expected |= {"time": 1.5, "sender": b"node"}  # type: ignore[dict-item]
    types = {"2": "2s", "u8": "B", "u16": "H", "u64": "Q", "f64": "d", "name_length": "4s"}
    assert {name: struct.unpack_from("<" + types[kind], data, int(at))[0] for at, kind, name in fields} == expected
    assert struct.unpack_from("<6d", data, 36) == (*frame.facts, 2.0, 3.0)
    assert len(data) == 36 + 6 * 8


def test_the_topics_and_fields_of_a_log_are_those_of_the_page() -> None:
    rows = re.findall(r"^\| `(/\S+)` \| `(trigpoint\.\w+)` \| (.*) \|$", PAGE, re.MULTILINE)
    assert {name for _, name, _ in rows} == set(SCHEMAS)
    for _, name, text in rows:
        properties = set(SCHEMAS[name]["properties"])
        if name == "trigpoint.Status":
            properties |= set(SCHEMAS[name]["properties"]["links"]["items"]["properties"])
        said = set(re.findall(r"`(\w+)`", text)) - {"hello", "bye", "ping", "pong", "control"}
        assert said == properties, name
    for word in (f"`{LABEL}`", f"`{LOG_KIND}`", f"`{LOG_VERSION}`"):
        assert word in PAGE


DRIVER = r"""
#include <stdio.h>
#include <stdlib.h>
int main(void)
{
    static uint8_t data[65536];
    static struct tp_estimate e;
    uint32_t length;
    while (fread(&length, 4, 1, stdin) == 1) {
        if (fread(data, 1, length, stdin) != length) return 2;
        /* a copy of the exact size, so that a sanitizer sees any byte beyond */
        uint8_t *copy = malloc(length ? length : 1);
        memcpy(copy, data, length);
        if (tp_read_estimate(copy, length, &e) == 0) {
            printf("%zu %u %llu %llu %a %a %a %a %a", strlen(e.sender), e.head.count,
                   (unsigned long long)e.head.epoch, (unsigned long long)e.head.sequence, e.head.time,
                   e.hops, e.evidence, e.broken, e.uncertainty);
            for (unsigned k = 0; k < e.head.count; k++) printf(" %a", e.values[k]);
            printf("\n");
        } else printf("none\n");
        free(copy);
    }
    return 0;
}
"""


def frames() -> list[Frame]:
    rng = np.random.default_rng(5)
    sizes = (0, 1, 3, 4096)
    found = [
        Frame(Kind.ESTIMATE, name, 2**64 - 1 - k, k, 1.7e9 + k / 3, tuple(rng.normal(size=4)), rng.normal(size=size))
        for k, (name, size) in enumerate(zip(NAMES, sizes, strict=True))
    ]
    return [*found, truth("a", 0, 1.0, [1.0]), reading(0, 0, 1.0, [1.0])]


def test_the_lines_of_c_read_our_frames(tmp_path: Path) -> None:
    (code,) = re.findall(r"```c\n(.*?)```", PAGE, re.DOTALL)
    compiler = shutil.which("gcc") or shutil.which("cc")
    if compiler is None:  # the layout itself is checked above
        print("no C compiler here: the lines of C on the page were not compiled")
        return
    (tmp_path / "read.c").write_text(code + DRIVER, encoding="utf-8")
    strict = ["-std=c11", "-Wall", "-Wextra", "-Werror", "-pedantic", "-O1", "-fsanitize=address,undefined"]
    subprocess.run([compiler, *strict, "read.c", "-o", "read"], cwd=tmp_path, check=True)
    sent = frames()
    data = [encode_frame(frame) for frame in sent]
    cut = [piece[:k] for piece in data[:2] for k in range(len(piece))] + [data[1] + b"\0"]
    stream = b"".join(struct.pack("<I", len(piece)) + piece for piece in (*data, *cut))
    done = subprocess.run([tmp_path / "read"], input=stream, capture_output=True, check=True)
    lines = done.stdout.decode().splitlines()
    for frame, line in zip(sent[:4], lines[:4], strict=True):
        length, count, epoch, sequence, *numbers = line.split()
        assert int(length) == len(frame.sender.encode())
        assert (int(count), int(epoch), int(sequence)) == (frame.values.shape[0], *frame.age_key)
        assert [float.fromhex(text) for text in numbers] == [frame.time, *frame.facts, *frame.values]
    assert lines[4:] == ["none"] * (2 + len(cut))


def test_the_client_needs_no_more_than_zenoh() -> None:
    text = CLIENT.read_text(encoding="utf-8")
    assert "import trigpoint" not in text
    assert "from trigpoint" not in text
    assert len(text.splitlines()) < 100


def test_the_client_hears_a_network(tmp_path: Path) -> None:
    """Two nodes with addresses of their own, as peers do not forward; other kinds of frames are passed over."""
    where = {name: address("unixsock-stream") for name in ("a", "µ/ %")}
    links = {name: ZenohTransport(address, []) for name, address in where.items()}
    environment = {key: value for key, value in os.environ.items() if key != "PYTHONPATH"}
    command = [sys.executable, str(CLIENT), "net 1", *where.values(), "--count", "6", "--for", "120"]
    try:
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, cwd=tmp_path, env=environment) as client:
            assert client.stdout is not None
            k = 0
            while client.poll() is None:
                for name, link in links.items():
                    link.publish(node_key("net 1", name, "estimate"), encode_frame(truth(name, k, 1.0, [0.0])))
                    frame = estimate(name, k, 2.0 + k, [0.5, -k], evidence=1.0)
                    link.publish(node_key("net 1", name, "estimate"), encode_frame(frame))
                k += 1
                try:
                    client.wait(0.05)
                except subprocess.TimeoutExpired:
                    assert k < 1200, "the client heard nothing"  # for a minute at least
            heard = [json.loads(line) for line in client.stdout]
    finally:
        for link in links.values():
            link.close()
    assert client.returncode == 0
    assert len(heard) == 6
    assert {one["node"] for one in heard} == set(where)
    for one in heard:
        assert one["values"] == [0.5, -one["sequence"]]
        assert (one["hops"], one["evidence"], one["uncertainty"]) == (2.0, 1.0, 0.25)
        assert one["time"] == 2.0 + one["sequence"]


class Mailbox:
    """Hands what is published to one machine."""

    def __init__(self, machine: NodeMachine, now: float) -> None:
        self.machine, self.now = machine, now

    def publish(self, key: str, data: bytes) -> None:
        self.machine.receive(self.now, key, data)


@pytest.mark.parametrize("offset", [0.0, -0.1])
def test_a_node_takes_our_readings_as_those_of_a_plant(offset: float) -> None:
    settings = case().settings()[0]
    machine = NodeMachine(settings, epoch=1, now=100.0)
    publisher = ReadingPublisher(Mailbox(machine, 100.0), "net", SENSOR, epoch=7)  # type: ignore[arg-type]
    labels = [arc.label for arc in settings.program.arcs]
    for label in labels:
        publisher.publish(Reading(100.0 + offset, label, np.array([0.25])))
    counters = machine.counters
    assert (counters.accepted, counters.dropped) == (len(labels), 0)
    publisher.publish(Reading(100.0, labels[0], np.array([0.25, 1.0])))  # no size that this arc has
    assert machine.counters.rejected["size"] == 1
