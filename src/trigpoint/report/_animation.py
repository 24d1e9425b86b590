"""A run as a moving picture: GIF, MP4, or one HTML file that plays it."""

from __future__ import annotations

import base64
import html
import io
import json
import shutil
import subprocess
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from trigpoint.errors import ArgumentError, ShapeError
from trigpoint.graphs import MeasurementGraph
from trigpoint.report import _engines
from trigpoint.report._staging import Staging
from trigpoint.report._text import printable

if TYPE_CHECKING:
    from trigpoint.observers.run import Run

Kind = Literal["gif", "html", "mp4"]
ANIMATIONS: tuple[str, ...] = get_args(Kind)
"""What ``animation`` makes."""

_LARGEST = 3000
_PAGE = """<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta http-equiv="Content-Security-Policy" content="default-src 'none'; style-src 'unsafe-inline'; script-src 'unsafe-inline'; img-src data:">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>{title}</title>
<style>
body {{ margin: 0 auto; max-width: 70rem; padding: 1rem; font: 1rem/1.5 system-ui, sans-serif; color: #1b2733; background: #fff }}
h1 {{ font-size: 1.3rem }}
img {{ width: 100%; height: auto; display: block }}
form {{ display: flex; gap: 1rem; align-items: center; margin-top: .5rem }}
input {{ flex: 1 }}
button {{ font: inherit; min-width: 5rem; padding: .2rem 1rem }}
output {{ min-width: 8rem; text-align: right; font-variant-numeric: tabular-nums }}
</style>
</head>
<body>
<h1>{title}</h1>
<img id="frame" alt="The network coloured by the error, and the error norm over time">
<form>
<button type="button" id="play">Pause</button>
<input type="range" id="place" min="0" max="{last}" value="0" aria-label="frame">
<output id="time"></output>
</form>
<script>
const frames = {frames}, times = {times}, wait = {wait};
const frame = document.getElementById("frame"), place = document.getElementById("place");
const play = document.getElementById("play"), time = document.getElementById("time");
let timer = null;
function show(k) {{ place.value = k; frame.src = "data:image/png;base64," + frames[k]; time.value = times[k] + " s"; }}
function run() {{ timer = setInterval(() => show((Number(place.value) + 1) % frames.length), wait); play.textContent = "Pause"; }}
function stop() {{ clearInterval(timer); timer = null; play.textContent = "Play"; }}
play.addEventListener("click", () => timer === null ? run() : stop());
place.addEventListener("input", () => {{ stop(); show(Number(place.value)); }});
show(0);
if (matchMedia("(prefers-reduced-motion: reduce)").matches) stop(); else run();
</script>
</body>
</html>
"""  # noqa: E501


def animation(
    run: Run,
    graph: MeasurementGraph,
    kind: Kind,
    *,
    staging: Staging | None = None,
    frames: int = 100,
    rate: float = 20.0,
    title: str = "",
) -> bytes:
    """Draw a run as a moving picture: the network coloured by the error on the left, the error norm on the right.

    Args:
        run: what ``simulate`` or a live run recorded.
        graph: its network.
        kind: ``gif``; ``mp4`` (needs the program ffmpeg); ``html`` (one file that plays itself and asks nothing of any
            host).
        staging: what is shown; see ``Staging``.
        frames: how many, evenly among the samples.
        rate: frames a second.
        title: a line above the picture.

    Returns the bytes of the file. Nodes that move are drawn where they are, with a line to where they believe to be.

    Raises:
        ArgumentError: no sample, an unknown kind, frames or a rate that are not positive, more than 3000 nodes; no
            ffmpeg for ``mp4``, or one that failed.
        ShapeError: the graph has another number of nodes than the run.
        MissingExtraError: matplotlib is not installed.
    """
    if graph.n_nodes != len(run.names):
        raise ShapeError(f"graph has {graph.n_nodes} nodes; the run has {len(run.names)}")
    if kind not in ANIMATIONS:
        raise ArgumentError(f"an animation is one of {', '.join(ANIMATIONS)}; got {kind!r}")
    if not run.times.size or frames < 1 or not 0.0 < rate <= 100.0 or graph.n_nodes > _LARGEST:
        raise ArgumentError(
            f"an animation needs samples, frames >= 1, 0 < rate <= 100 and at most {_LARGEST} nodes; got "
            f"{run.times.size} samples, {frames} frames, rate {rate:g}, {graph.n_nodes} nodes"
        )
    program = _ffmpeg() if kind == "mp4" else ""
    shown = np.unique(np.linspace(0, run.times.size - 1, min(frames, run.times.size)).round().astype(int))
    pictures = _pictures(run, graph, staging or Staging(), shown.tolist(), "" if kind == "html" else printable(title))
    if kind == "gif":
        return _gif(pictures, rate)
    if kind == "mp4":
        return _mp4(pictures, rate, program)
    return _page(pictures, rate, printable(title) or "Run", [f"{time:.4g}" for time in run.times[shown].tolist()])


def _pictures(
    run: Run, graph: MeasurementGraph, staging: Staging, shown: list[int], title: str
) -> list[NDArray[np.uint8]]:  # fmt: skip
    """(height, width, 3) of every frame; even numbers of both, as MP4 wants them."""
    with _engines.styled() as new_figure:
        from matplotlib.backends.backend_agg import FigureCanvasAgg

        figure = new_figure(figsize=(9.0, 4.4), dpi=100, facecolor="white")
        canvas: Any = FigureCanvasAgg(figure)
        update = staging.on(figure, run, graph, title)
        found = []
        for k in shown:
            update(k)
            canvas.draw()
            found.append(np.array(np.asarray(canvas.buffer_rgba())[:, :, :3]))
    return found


def _images(pictures: list[NDArray[np.uint8]]) -> list[Any]:
    from PIL import Image

    return [Image.fromarray(picture) for picture in pictures]


def _gif(pictures: list[NDArray[np.uint8]], rate: float) -> bytes:
    images, buffer = _images(pictures), io.BytesIO()
    images[0].save(buffer, "GIF", save_all=True, append_images=images[1:], duration=1000.0 / rate, loop=0)
    return buffer.getvalue()


def _page(pictures: list[NDArray[np.uint8]], rate: float, title: str, times: list[str]) -> bytes:
    coded = []
    for image in _images(pictures):
        buffer = io.BytesIO()
        image.quantize(128).save(buffer, "PNG", optimize=True)
        coded.append(base64.b64encode(buffer.getvalue()).decode("ascii"))
    text = _PAGE.format(
        title=html.escape(title),
        last=len(coded) - 1,
        frames=json.dumps(coded),
        times=json.dumps(times),
        wait=1000.0 / rate,
    )
    return text.encode("utf-8", "replace")


def _ffmpeg() -> str:
    program = shutil.which("ffmpeg")
    if program is None:
        raise ArgumentError("an .mp4 needs the program ffmpeg, which is not on the PATH: install it, or write a .gif")
    return program


def _mp4(pictures: list[NDArray[np.uint8]], rate: float, program: str) -> bytes:
    height, width, _ = pictures[0].shape
    with tempfile.TemporaryDirectory() as folder:
        target = Path(folder) / "run.mp4"
        source = ["-f", "rawvideo", "-pix_fmt", "rgb24", "-s", f"{width}x{height}", "-r", f"{rate:g}", "-i", "-"]
        coding = ["-an", "-pix_fmt", "yuv420p", "-movflags", "+faststart", str(target)]
        raw = b"".join(picture.tobytes() for picture in pictures)
        done = subprocess.run([program, "-loglevel", "error", "-y", *source, *coding], input=raw, capture_output=True)
        if done.returncode != 0 or not target.is_file():
            said = done.stderr.decode("utf-8", "replace").strip()[-300:]
            raise ArgumentError(f"ffmpeg could not write the .mp4: {said or 'it gave no reason'}; write a .gif")
        return target.read_bytes()
