"""``trigpoint demo``: the main job on a real levelling network, from the file to the report."""

from __future__ import annotations

import csv
from importlib.resources import files
from pathlib import Path
from typing import Annotated

import typer
from rich.table import Table

from trigpoint.analysis import diagnose
from trigpoint.cli.check import gain_table, network_table
from trigpoint.cli.demo_report import demo_page
from trigpoint.cli.demo_story import Story, facts, observer_lines, tell
from trigpoint.cli.shell import FAILS, HOLDS, Json, console, emit, guarded, tracked
from trigpoint.io import write_atomically
from trigpoint.report import render

Folder = Annotated[Path, typer.Option("--out", help="Folder for the report and a copy of the data.")]


@guarded
def demo(out: Folder = Path("trigpoint-demo"), as_json: Json = False) -> int:
    """Walk through the main job on a real levelling network and write a report. Takes seconds."""
    steps = iter(tracked("demo")(range(6)))
    data = files("trigpoint.cli") / "data"
    out.mkdir(parents=True, exist_ok=True)
    for name in ("baumann.csv", "baumann_published.csv"):
        write_atomically(out / name, (data / name).read_bytes())
    story = tell(out / "baumann.csv", _published(out / "baumann_published.csv"), steps)
    report = out / "report.html"
    write_atomically(report, render(demo_page(story)))
    for _ in steps:
        pass
    if as_json:
        emit({**facts(story), "report": str(report)})
    else:
        _show(story, report)
    return HOLDS if story.holds else FAILS


def _published(path: Path) -> dict[str, tuple[float, float]]:
    rows = csv.DictReader(line for line in path.read_text(encoding="utf-8").splitlines() if not line.startswith("#"))
    return {row["mark"]: (float(row["height"]), float(row["sigma"])) for row in rows}


def _show(story: Story, report: Path) -> None:
    out = console()
    graph = story.network.graph
    out.print("1. The network", style="bold")
    out.print(story.network.title.splitlines()[0])
    out.print(network_table(graph))
    diagnosis = diagnose(graph)
    out.print(f"can every mark be known: {'yes' if diagnosis.observable else 'no'} ({diagnosis.theorem})")
    out.print("\n2. The gain it needs (unit weights, whole graph)", style="bold")
    out.print(gain_table(graph, story.bound))
    out.print("\n3. The best static answer (weighted least squares)", style="bold")
    out.print(heights_table(story))
    out.print(
        f"largest difference to the published heights: {story.largest_difference:.1e} m "
        f"(standard deviations: {story.largest_sigma_difference:.1e} of their value)"
    )
    out.print("\n4. The observer: every mark by itself, with its neighbours only", style="bold")
    table = Table(show_header=False, box=None, pad_edge=False)
    for label, text in observer_lines(story):
        table.add_row(label, text)
    out.print(table)
    out.print("\n5. The report", style="bold")
    out.print(report.resolve().as_uri())


def heights_table(story: Story) -> Table:
    """Our heights beside the published ones."""
    table = Table("mark", "height [m]", "sigma [mm]", "published [m]", "sigma [mm]", box=None, pad_edge=False)
    for name, height, sigma in zip(story.answer.names, story.answer.x, story.answer.sigma, strict=True):
        if name in story.published:
            there, spread = story.published[name]
            table.add_row(name, f"{height:.6f}", f"{1e3 * sigma:.4f}", f"{there:.6f}", f"{1e3 * spread:.4f}")
        else:
            table.add_row(name, f"{height:.6f}", "known", "", "", style="dim")
    return table
