"""Pictures of runs: connectivity, paths, and moving pictures that are what they say and ask nobody."""

import io
import re
import shutil
from itertools import combinations

import numpy as np
import pytest
from PIL import Image

import trigpoint as tp
from trigpoint.errors import ArgumentError, ShapeError
from trigpoint.report import ANIMATIONS, Staging, animation, connectivity_figure, render, run_page, trajectory_figure
from trigpoint.report._engines import styled
from trigpoint.simulation import Bouncing, Scenario, proximity, simulate

from .test_report_figures import SVG, checked, texts

PAIRS = list(combinations(range(5), 2))
GRAPH = tp.MeasurementGraph(5, [a for a, _ in PAIRS] + [-1], [b for _, b in PAIRS] + [0])
PLANE = tp.LinearAgent(np.kron([[0.0, 1.0], [0.0, 0.0]], np.eye(2)), np.kron([[1.0, 0.0]], np.eye(2)))
MOTION = Bouncing.drawn(5, 2.0, (0.5, 1.0), np.random.default_rng(3))
TOPOLOGY = proximity(MOTION, PAIRS, 1.0, 4.0, always=1)
TIMES = np.linspace(0.0, 4.0, 41)


@pytest.fixture(scope="module")
def moving():
    problem = tp.NetworkedAgents(GRAPH, PLANE)
    observer = tp.design(problem, tp.methods.LocalKalman(tp.Fixed(15.0)))
    return simulate(problem, observer, Scenario(TIMES, 1.0, motion=MOTION, topology=TOPOLOGY))


def test_connectivity_names_the_gain_and_shades_what_no_gain_helps(moving):
    assert (moving.lambda_min == 0.0).any()
    svg = connectivity_figure(moving.times, moving.lambda_min, 15.0)
    assert svg == connectivity_figure(moving.times, moving.lambda_min, 15.0)
    words = texts(svg)
    assert "gain in force, 15" in words
    assert "gain needed" in words
    stretches = int((np.diff((moving.lambda_min == 0.0).astype(int)) == 1).sum() + (moving.lambda_min[0] == 0.0))
    assert svg.count("fill: #dfe4e9") == stretches
    several = connectivity_figure(TIMES, {"1 anchor": np.full(41, 0.1), "2 $anchors": np.full(41, 0.3)})
    assert {"1 anchor", "2 $anchors"} <= set(texts(several))
    checked(connectivity_figure([0.0], [0.0]))


@pytest.mark.parametrize(
    ("arguments", "kind", "words"),
    [
        (([], []), ArgumentError, "at least one time"),
        (([0.0, 1.0], [1.0]), ShapeError, "must be vectors of one length"),
        (([0.0], [-1.0]), ArgumentError, "is negative at time 0"),
        (([0.0], [1.0], 0.0), ArgumentError, "gain must be positive; got 0"),
    ],
)
def test_connectivity_refuses_nonsense(arguments, kind, words):
    with pytest.raises(kind, match=words):
        connectivity_figure(*arguments)


def test_paths_are_drawn_in_the_plane_or_over_time(moving):
    plane = trajectory_figure(moving, unit="m")
    assert {"state 0 [m]", "state 1 [m]", "truth", "estimate"} <= set(texts(plane))
    assert "time [s]" in texts(trajectory_figure(moving, axes=(2,), nodes=[1]))
    lines = checked(plane).findall(f".//{SVG}g")
    assert lines
    for options, words in (
        ({"axes": (0, 7)}, "one or two of the 4 states"),
        ({"axes": (0, 1, 2)}, "one or two of the 4 states"),
        ({"nodes": []}, "at least one node"),
    ):
        with pytest.raises(ArgumentError, match=words):
            trajectory_figure(moving, **options)


def test_the_page_of_a_moving_run_shows_both(moving):
    page = run_page(moving, title="x")
    assert [section.title for section in page.sections][2:4] == ["Connectivity", "Paths"]
    assert "https:" not in render(page)


def test_a_gif_has_its_frames_and_its_nodes_move(moving):
    active = np.array([TOPOLOGY.at(time) for time in TIMES])
    staging = Staging(axes=(0, 1), active=active, rate=0.5, unit="m")
    data = animation(moving, GRAPH, "gif", staging=staging, frames=5, rate=10.0, title="Five")
    assert data == animation(moving, GRAPH, "gif", staging=staging, frames=5, rate=10.0, title="Five")
    picture = Image.open(io.BytesIO(data))
    assert (picture.format, picture.n_frames, picture.info["loop"]) == ("GIF", 5, 0)
    seen = []
    for k in range(5):
        picture.seek(k)
        assert picture.info["duration"] == 100
        seen.append(np.asarray(picture.convert("RGB")).astype(int))
    left = [frame[60:400, :420] for frame in seen]
    assert all(np.abs(one - other).sum() > 0 for one, other in combinations(left, 2))


def test_names_stand_beside_few_nodes_and_colours_say_which_is_worse(moving):
    with styled() as new_figure:
        figure = new_figure(figsize=(9.0, 4.4))
        update = Staging(axes=(0, 1), rate=0.5, rate_name="a rate").on(figure, moving, GRAPH, "")
        update(7)
        names = figure.axes[0].texts
        assert [text.get_text() for text in names] == list(GRAPH.names)
        np.testing.assert_allclose([text.xy for text in names], moving.truth[7, :, :2])
        assert any("darker is worse" in axes.get_ylabel() for axes in figure.axes)
        assert figure.axes[1].get_legend().get_texts()[0].get_text() == "a rate, 0.5 1/s"
        problem = tp.NetworkedAgents(tp.graphs.chain(30, anchors=(0,)), tp.LinearAgent.static())
        run = simulate(problem, tp.design(problem, tp.methods.IntegratorObserver()), Scenario([0.0, 1.0]))
        many = new_figure(figsize=(9.0, 4.4))
        Staging().on(many, run, problem.graph, "")(0)
        assert not many.axes[0].texts


def test_a_page_plays_by_itself_and_asks_nobody(moving):
    page = animation(moving, GRAPH, "html", frames=3, title="<script>alert(1)</script>").decode()
    assert "<script>alert(1)" not in page
    assert "default-src 'none'" in page
    assert not re.findall(r"(?:https?:)?//[a-z]", page.split("const frames")[0])
    frames = re.search(r"const frames = (\[.*?\]),", page).group(1)
    assert frames.count('"') == 6
    assert "0 s" not in frames
    assert re.search(r'times = \["0", "2", "4"\]', page)


def test_an_mp4_goes_through_ffmpeg(moving, monkeypatch, tmp_path):
    """A stand-in for the program sees whole frames of an even size, and its failure is told."""
    fake = tmp_path / "ffmpeg"
    fake.write_text('#!/bin/sh\nfor last; do :; done\nprintf "%s\\n" "$*" > "$last"\nwc -c >> "$last"\n')
    fake.chmod(0o755)
    monkeypatch.setattr(shutil, "which", lambda _: str(fake))
    words, count = animation(moving, GRAPH, "mp4", frames=2).decode().splitlines()
    width, height = (int(number) for number in re.search(r"-s (\d+)x(\d+)", words).groups())
    assert width % 2 == height % 2 == 0
    assert int(count) == 2 * 3 * width * height
    fake.write_text("#!/bin/sh\ncat > /dev/null\necho no codec >&2\nexit 1\n")
    with pytest.raises(ArgumentError, match=r"ffmpeg could not write the \.mp4: no codec"):
        animation(moving, GRAPH, "mp4", frames=1)
    monkeypatch.setattr(shutil, "which", lambda _: None)
    with pytest.raises(ArgumentError, match=r"needs the program ffmpeg.*write a \.gif"):
        animation(moving, GRAPH, "mp4", frames=1)


@pytest.mark.parametrize(
    ("options", "kind", "words"),
    [
        ({"kind": "avi"}, ArgumentError, "one of gif, html, mp4; got 'avi'"),
        ({"frames": 0}, ArgumentError, "frames >= 1"),
        ({"rate": 0.0}, ArgumentError, "0 < rate <= 100"),
        ({"graph": tp.graphs.chain(3)}, ShapeError, "graph has 3 nodes; the run has 5"),
        ({"staging": Staging(axes=(0, 9))}, ArgumentError, "axes must be two of the 4 states"),
        ({"staging": Staging(positions=np.zeros((2, 2)))}, ShapeError, r"positions must have shape \(5, 2\)"),
        (
            {"staging": Staging(active=np.ones((2, 2)))},
            ShapeError,
            r"active must have shape \(samples, arcs\) = \(41, 11\)",
        ),
    ],
)
def test_moving_pictures_refuse_nonsense(moving, options, kind, words):
    with pytest.raises(kind, match=words):
        animation(moving, **{"graph": GRAPH, "kind": "gif", "frames": 1, **options})
    assert ANIMATIONS == ("gif", "html", "mp4")
