"""Pages: one file, nothing from outside, everything escaped."""

import sys
from dataclasses import replace
from html.parser import HTMLParser

import numpy as np
import pytest

from trigpoint import graphs
from trigpoint.errors import ArgumentError, MissingExtraError, ShapeError
from trigpoint.observers.run import Run
from trigpoint.report import Figure, Page, Section, Table, error_figure, render, run_page
from trigpoint.report._text import cell
from trigpoint.simulation import (
    Absence,
    Bursts,
    Channel,
    Clocks,
    Noise,
    Outage,
    Scenario,
    Topology,
    Trajectory,
    Trigger,
)
from trigpoint.simulation.documents import scenario_document

HOSTILE = "<script>alert('x')</script><img src=http://evil.example/x>\" onload=\"x"
SVG = '<svg xmlns="http://www.w3.org/2000/svg"><g/></svg>'
VOID = {"meta"}


class Reader(HTMLParser):
    """Collects elements, attributes and text, and checks that elements close in order."""

    def __init__(self):
        super().__init__()
        self.elements, self.open, self.text = [], [], []

    def handle_starttag(self, tag, attrs):
        self.elements.append((tag, dict(attrs)))
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag, attrs):
        self.elements.append((tag, dict(attrs)))

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.text.append(data)

    def all(self, tag):
        return [attributes for name, attributes in self.elements if name == tag]


def read(html):
    reader = Reader()
    reader.feed(html)
    reader.close()
    assert not reader.open
    for tag, attributes in reader.elements:
        assert tag not in {"script", "link", "img", "iframe", "object", "base", "form", "a"}
        for name, value in attributes.items():
            assert not name.startswith("on")
            if name in {"src", "href", "xlink:href", "action"}:
                assert value.startswith(("#", "data:"))
    assert "url(http" not in html
    assert "@import" not in html
    return reader


def recorded(names=("a", "b", "c"), samples=5):
    times = np.linspace(0.0, 4.0, samples)
    truth = np.zeros((samples, len(names), 2))
    estimate = truth + np.exp(-times)[:, None, None] * (1.0 + np.arange(len(names)))[:, None]
    messages = np.arange(samples)[:, None] * np.ones(len(names), dtype=np.int64)
    status = np.full((samples, len(names)), "anchored")
    return Run(times, truth, estimate, messages, status, tuple(names), "stacked", {"seed": 7, "note": HOSTILE})


def test_a_page_is_one_safe_accessible_file():
    items = (Table(("name", "value"), (("a", 1.5), ("b", None)), "A table"), Figure(SVG, "A figure"))
    reader = read(render(Page("Title", "Subtitle", (Section("First", "One.\n\nTwo.\r\n \r\nThree.", items),))))
    policy = [m["content"] for m in reader.all("meta") if m.get("http-equiv") == "Content-Security-Policy"]
    assert policy[0].startswith("default-src 'none'; style-src 'unsafe-inline'; img-src data:")
    assert reader.all("html") == [{"lang": "en"}]
    assert any(m.get("name") == "viewport" for m in reader.all("meta"))
    assert {th["scope"] for th in reader.all("th")} == {"col", "row"}
    assert reader.all("td")[0]["class"] == "right"
    assert len(reader.all("figure")) == len(reader.all("figcaption")) == 1
    assert len([p for p in reader.all("p") if "class" not in p]) == 3


def test_every_text_is_escaped():
    table = Table((HOSTILE, "b"), ((HOSTILE, HOSTILE),), HOSTILE)
    page = Page(HOSTILE, HOSTILE, (Section(HOSTILE, HOSTILE, (table, Figure(SVG, HOSTILE))),))
    reader = read(render(page))
    assert reader.text.count(HOSTILE) >= 8


def test_what_utf8_cannot_carry_is_replaced():
    html = render(Page("a\x00b\ud800", "", (Section("s", items=(Table(("c",), (("\x1b[31m",),)),)),)))
    assert "a\ufffdb\ufffd" in html
    html.encode("utf-8")


def test_render_is_deterministic_and_handles_the_empty():
    page = Page("Nothing", "", (Section("Empty", items=(Table(("a",), ()),)),))
    assert render(page) == render(page)
    read(render(page))
    read(render(Page("", "", ())))


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (None, "\u2013"),
        (np.nan, "\u2013"),
        (-np.inf, "\u2212∞"),
        (np.inf, "∞"),
        (True, "yes"),
        (np.False_, "no"),
        (-12345, "\u221212\u202f345"),
        (np.int64(3), "3"),
        (1 / 3, "0.333333"),
        (np.float32(-0.5), "\u22120.5"),
        ("as it is", "as it is"),
    ],
)
def test_cells(value, text):
    assert cell(value) == text


def test_alignment_follows_the_cells():
    table = Table(("a", "b", "c", "d"), (("x", 1, None, True), ("y", 2.0, None, False)))
    assert table.alignments == ("left", "right", "left", "left")
    assert Table(("a",), (), align=("right",)).alignments == ("right",)


def test_a_folded_table_shows_its_caption_once():
    table = Table(("a",), (("x",),), "all of it", ("whole",), folded=True)
    text = render(Page("t", "", (Section("s", "", (table,)),)))
    assert "<summary>all of it</summary>" in text
    assert "<caption>" not in text
    assert 'class="whole"' in text


@pytest.mark.parametrize(
    ("build", "error", "text"),
    [
        (lambda: Table(("a", "b"), ((1, 2), (1,))), ShapeError, "row 1 of the table has 1 cells"),
        (lambda: Table(("a",), (), align=("left", "left")), ShapeError, "align has 2 entries"),
        (lambda: Table(("a",), (), align=("middle",)), ArgumentError, "'middle'"),
        (lambda: Table(("a",), (), folded=True), ArgumentError, "needs a caption"),
        (lambda: Figure("<!DOCTYPE svg><svg/>", ""), ArgumentError, "DOCTYPE"),
        (lambda: Figure("<svg>", ""), ArgumentError, "well-formed"),
        (lambda: Figure("<p/>", ""), ArgumentError, "must be an <svg>"),
        (lambda: Figure("<svg><script/></svg>", ""), ArgumentError, "<script>"),
        (lambda: Figure('<svg onload="x"/>', ""), ArgumentError, "event handler"),
        (lambda: Figure('<svg><use href="http://evil.example"/></svg>', ""), ArgumentError, "outside itself"),
        (lambda: Figure("<svg><style>@import 'x';</style></svg>", ""), ArgumentError, "outside itself"),
        (lambda: Figure('<svg style="fill: url(http://x)"/>', ""), ArgumentError, "outside itself"),
        (lambda: Figure("<svg><?xml-stylesheet href='x'?></svg>", ""), ArgumentError, "processing instruction"),
    ],
)
def test_misuse(build, error, text):
    with pytest.raises(error, match=text):
        build()


def test_a_real_figure_is_accepted():
    svg = error_figure([0, 1], [2, 1])
    assert Figure(svg, "").svg == svg


def test_missing_jinja2_is_named_at_use(monkeypatch):
    monkeypatch.setitem(sys.modules, "jinja2", None)
    with pytest.raises(MissingExtraError, match=r"'jinja2'.*trigpoint\[report\]"):
        render(Page("", "", ()))


def test_run_page_tells_the_numbers():
    page = run_page(recorded(), title="T", graph=graphs.chain(3), rate=0.9, unit="m")
    assert [section.title for section in page.sections] == [
        "Summary",
        "Error over time",
        "Network",
        "Nodes at the last sample",
    ]
    reader = read(render(page))
    text = "".join(reader.text)
    assert "0.09692" in text  # the last error norm: sqrt(2 (1 + 4 + 9)) exp(-4) = 5.2915 x 0.018316
    assert "guaranteed rate, 0.9 1/s" in text
    assert "final error [m], darker is worse" in text
    assert HOSTILE[:40] in text
    assert render(page) == render(run_page(recorded(), title="T", graph=graphs.chain(3), rate=0.9, unit="m"))


def test_run_page_tells_its_scenario_in_words():
    channel = Channel(loss=0.1, delay=0.05, old="propagate", outages=(Outage(1.0, 2.0),))
    scenario = Scenario(
        np.linspace(0.0, 5.0, 6),
        period=0.1,
        channel=channel,
        seed=3,
        noise=Noise(0.01),
        absences=[Absence(1, 2.0, 3.0), Absence(2, 4.0)],
        topology=Topology([0.0, 1.0], np.ones((2, 3), dtype=bool)),
    )
    attributes = {
        "period": 0.1, "guaranteed_rate": None, "seed": 3, "noise_measurement": 0.01, "noise_process": 0.0,
        "loss": 0.1, "engines": ["series"], "scenario": scenario_document(scenario),
    }  # fmt: skip
    run = replace(recorded(), attributes=attributes)
    rows = dict(run_page(run, title="T", unit="m").sections[0].items[0].rows)
    assert not {"scenario", "guaranteed_rate", "noise_measurement"} & set(rows)
    assert rows["guaranteed decay rate [1/s]"] == "none for such a run"
    assert rows["noise of a reading, deviation [m]"] == 0.01
    assert rows["times asked for"] == "6, 0 s to 5 s"
    assert rows["channel"] == "loss 0.1, delay 0.05 s, 1 outage, old messages: propagate"
    assert rows["node away"] == "c, from 4 s on"
    assert rows["working arcs, changes"] == 1
    assert "base64" not in render(run_page(run, title="T"))
    smooth = run_page(replace(run, attributes={**attributes, "period": None}), title="T")
    assert dict(smooth.sections[0].items[0].rows)["period of exchange [s]"] == "none: continuous exchange"
    strange = run_page(replace(run, attributes={"scenario": {"times": 1}}), title="T")
    assert "does not read" in dict(strange.sections[0].items[0].rows)["scenario"]


def test_every_part_of_a_scenario_has_words():
    times, three = [0.0, 1.0], np.zeros((2, 3, 4))
    for motion, words in ((Trajectory(times, three), "known"), (Trajectory(times, three, known=False), "not known")):
        scenario = Scenario(
            times, period=0.1, clocks=Clocks(), trigger=Trigger(0.5, 0.1), motion=motion, inputs=np.ones((3, 1)),
            channel=Channel(bursts=Bursts(0.1, 0.5), old="use"),
            absences=[Absence(k % 3, 9.0 * k, 9.0 * k + 1.0) for k in range(7)],
        )  # fmt: skip
        run = replace(recorded(), attributes={"scenario": scenario_document(scenario)})
        rows = dict(run_page(run, title="T").sections[0].items[0].rows)
        assert words in rows["motion"]
        assert (rows["clocks"], rows["inputs"]) == ("each node its own", "known, constant")
        assert rows["a node sends when off by"] == "0.5 exp(\u22120.1 t)"
        assert rows["channel"] == "bursts, old messages: use"
        assert rows["further absences"] == 2


def test_contents_and_notes_of_a_table():
    table = Table(("a", "note"), (("x", "1"),), notes=("said <once>",))
    page = Page("t", "", (Section("First", "", (table,)), Section("Second")), contents=True)
    text = render(page)
    assert '<a href="#section-2">Second</a>' in text
    assert "<li>said &lt;once&gt;</li>" in text
    assert render(Page("t", "", (Section("s", "Not so (E-000-5) <b>."),))).count(
        '(<span class="whole">E-000-5</span>) &lt;b&gt;.'
    )
    assert "<nav" not in render(Page("t", "", (Section("First", "", (table,)),)))


def test_run_page_lists_two_hundred_nodes():
    page = run_page(recorded(tuple(str(k) for k in range(1250))), title="Many")
    nodes = page.sections[-1]
    assert len(nodes.items[0].rows) == 200
    assert "1\u202f050 more" in nodes.text


def test_run_page_leaves_out_nan_and_zero():
    run = recorded()
    run.estimate[0, 0] = np.nan
    page = run_page(run, title="Late start")
    assert "1 sample with a node without an estimate left out" in page.sections[1].items[0].caption
    run.estimate[:, 0] = np.nan
    assert "NaN throughout" in run_page(run, title="Never").sections[1].text
    run.estimate[:] = run.truth
    read(render(run_page(run, title="Exact", rate=1.0)))
    run.estimate[:] = np.nan
    read(render(run_page(run, title="Nothing", graph=graphs.chain(3))))


def test_run_page_misuse():
    with pytest.raises(ShapeError, match="graph has 2 nodes; the run has 3"):
        run_page(recorded(), title="", graph=graphs.chain(2))
    run = recorded()
    series = (run.times, run.truth, run.estimate, run.messages, run.status)
    empty = Run(*(array[:0] for array in series), run.names, "stacked")
    with pytest.raises(ArgumentError, match="no samples"):
        run_page(empty, title="")
