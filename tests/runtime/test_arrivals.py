"""Who joined a run, by the files in its folder: found once, linked to, heard by the monitor from then on."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.runtime.given import case
from tests.runtime.test_joining import NEW, beside
from tests.runtime.test_monitor import Hand, estimate
from trigpoint.errors import ArgumentError
from trigpoint.runtime import LINK_FIELDS, STATUS_FIELDS, Frame, Kind, Monitor, encode_frame, join, write_settings
from trigpoint.runtime.arrivals import Arrivals, opener
from trigpoint.runtime.topics import node_key


class Link(Hand):
    def __init__(self, settings):
        super().__init__()
        self.settings, self.closed = settings, False

    def close(self):
        self.closed = True


@pytest.fixture
def run(tmp_path):
    """The files of five nodes, and a look-out for more."""
    nodes = beside()
    for k, node in enumerate(nodes):
        write_settings(node, tmp_path / f"node-{k}.json")
    (tmp_path / "plant.json").write_text("{}", encoding="utf-8")
    hand, links = Hand(), []
    monitor = Monitor(hand, "net", [node.program for node in nodes], hand)

    def link(settings):
        links.append(Link(settings))
        return links[-1]

    return nodes, Arrivals(tmp_path, nodes, monitor, link), monitor, links


def joining(nodes, folder, newcomer=NEW, who=(1, 4)):
    own, grown = join(newcomer, [nodes[k] for k in who])
    write_settings(own, folder / f"{newcomer.name}.json")
    for k, one in zip(who, grown, strict=True):
        write_settings(one, folder / f"node-{k}.json")
    return own, grown


def test_a_newcomer_is_found_and_heard(run, tmp_path):
    nodes, arrivals, monitor, links = run
    assert arrivals.look(0.0) == ()
    own, _ = joining(nodes, tmp_path)
    assert arrivals.look(0.5) == ()  # not before a second has passed
    assert [one.name for one in arrivals.look(1.0)] == ["new"]
    assert arrivals.look(2.0) == ()
    assert [one.name for one in arrivals.joined] == ["new"]
    assert arrivals.hears["new"] == ["1", "4"]
    assert arrivals.hears["4"] == ["3", "new"]
    assert arrivals.hears["0"] == ["1"]
    assert arrivals.anchors == ["0"]
    assert monitor.names == ("0", "1", "2", "3", "4", "new")
    key, data = estimate("new", 0, 100.0, [1.0, 2.0])
    links[0].feed(key.replace("/n/", "/net/"), data)
    for sequence, count in enumerate((1, 2)):  # before and after the neighbour has read its new file
        values = np.zeros(len(STATUS_FIELDS) + count * len(LINK_FIELDS))
        links[0].feed(
            node_key("net", "4", "status"), encode_frame(Frame(Kind.STATUS, "4", 1, sequence, 100.0, (), values))
        )
        assert monitor.poll() > 0
        status = monitor.snapshot().status[4]
        assert [link.neighbour for link in status.links] == ["3", "new"][:count]
    snapshot = monitor.snapshot()
    assert snapshot.names[-1] == "new"
    np.testing.assert_array_equal(snapshot.estimate[-1], [1.0, 2.0])
    assert np.isnan(snapshot.error[-1])
    assert (monitor.malformed, monitor.strangers) == (0, 0)
    with pytest.raises(ArgumentError, match="is heard already"):
        monitor.join(own.program, links[0], {})
    arrivals.close()
    assert links[0].closed


def test_another_may_join_the_one_that_came(run, tmp_path):
    nodes, arrivals, monitor, _ = run
    own, _ = joining(nodes, tmp_path)
    later, (again, _) = join(
        replace(NEW, name="later", labels=(40, 41), listen="tcp/127.0.0.1:7098", anchor_label=42, nodes=6),
        [replace(own, nodes=5), replace(nodes[2], nodes=5)],
    )
    arrivals.look(0.0)
    write_settings(later, tmp_path / "later.json")
    assert arrivals.look(1.0) == ()  # nobody names it yet
    write_settings(again, tmp_path / "new.json")
    assert [one.name for one in arrivals.look(2.0)] == ["later"]
    assert arrivals.hears["new"] == ["1", "4", "later"]
    assert arrivals.anchors == ["0", "later"]
    assert monitor.names[-2:] == ("new", "later")


def test_what_lies_about_is_nobody(run, tmp_path):
    """A file of an earlier run, of another network, of a node of the run, and what is none."""
    nodes, arrivals, monitor, _ = run
    own, _ = join(NEW, [nodes[1], nodes[4]])
    write_settings(own, tmp_path / "new.json")
    write_settings(replace(own, network="other"), tmp_path / "other.json")
    write_settings(nodes[3], tmp_path / "copy.json")
    (tmp_path / "odd.json").write_text("{", encoding="utf-8")
    assert arrivals.look(0.0) == arrivals.look(1.0) == ()
    assert monitor.names == case().names[:5]
    (tmp_path / "node-1.json").write_text("{", encoding="utf-8")
    assert arrivals.look(2.0) == ()


def test_one_that_cannot_be_linked_to_is_told_of(run, tmp_path):
    nodes, arrivals, monitor, _ = run

    def refuse(_):
        raise ArgumentError("no way")

    arrivals._link = refuse
    joining(nodes, tmp_path)
    assert arrivals.look(0.0) == ()
    assert arrivals.failures == ["'new' joined, but cannot be heard: no way"]
    assert "new" not in monitor.names


def test_links_are_opened_by_address(tmp_path):
    own, _ = join(replace(NEW, listen=f"tcp/127.0.0.1:{7099}"), [beside()[1], beside()[4]])
    link = opener("monitor", None)(own)
    link.close()
    assert [address.port for address in link._addresses] == [7099]
