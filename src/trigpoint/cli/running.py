"""``trigpoint run``: the network as real processes."""

from __future__ import annotations

import shutil
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import count
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.live import Live
from rich.table import Table

from trigpoint.analysis import diagnose
from trigpoint.cli.choices import method_of
from trigpoint.cli.compose import changed, part_of, read_any, with_options
from trigpoint.cli.live import LiveRun, facts_of, holds, log_of, replayed, seconds_of
from trigpoint.cli.live_plan import Design, Places, ignored_troubles, plan_of
from trigpoint.cli.nodes import Plain, warn_of
from trigpoint.cli.places import placed
from trigpoint.cli.recorded import Record, record_of
from trigpoint.cli.shell import FAILS, HOLDS, Input, Json, Out, console, emit, guarded, notice
from trigpoint.cli.watching import watched
from trigpoint.errors import ArgumentError
from trigpoint.io.sections import RunSection
from trigpoint.methods import design
from trigpoint.runtime.monitor import Snapshot
from trigpoint.runtime.plan import LivePlan

For = Annotated[str | None, typer.Option("--for", help="How long: 20s, 500ms, 2min; until Ctrl-C if absent.")]
Rate = Annotated[float | None, typer.Option("--rate", help="Exchanges a second (Hz).")]
Kind = Annotated[str | None, typer.Option("--transport", help="unixsock, tcp, udp, tls or quic.")]
PerProcess = Annotated[int | None, typer.Option("--agents-per-process", help="Nodes that share a process (1).")]
Prepare = Annotated[Path | None, typer.Option("--prepare", help="Write the settings to this folder and run nothing.")]


@guarded
def run_command(
    file: Input,
    duration: For = None,
    rate: Rate = None,
    transport: Kind = None,
    agents_per_process: PerProcess = None,
    prepare: Prepare = None,
    allow_plain: Plain = False,
    readings: Annotated[
        Path | None, typer.Option("--readings", help="Recorded readings (.mcap, .csv) instead of a simulated plant.")
    ] = None,
    speed: Annotated[float, typer.Option("--speed", help="How much faster than recorded they come.")] = 1.0,
    watch: Annotated[bool, typer.Option("--watch", help="Show the run on a page for the browser.")] = False,
    port: Annotated[int, typer.Option("--port", help="Port of that page, on 127.0.0.1.")] = 8765,
    out: Out = None,
    as_json: Json = False,
) -> int:
    """Run the network: one process a node, talking to its neighbours only; the plant is simulated beside them.

    Writes run.mcap beside the scenario, or with --out DIR there, with settings, outputs and status.json. An earlier log
    is kept as run-1.mcap, and so on.
    Ctrl-C ends it in order. Exit code 1: a node did not run, was not heard, or was not anchored, at the end.
    With --readings it ends when the record does, or --for later.
    """
    if readings is None and speed != 1.0:
        raise ArgumentError("--speed belongs to --readings")
    if readings is not None and prepare is not None:
        raise ArgumentError("--prepare runs nothing; leave --readings out")
    seconds = None if duration is None else seconds_of(duration)
    given = read_any(file)
    section = changed_run(given.run, rate=rate, transport=transport, agents_per_process=agents_per_process)
    choices = changed(given.design)
    part = part_of(given, choices)
    diagnosis = diagnose(part.problem)
    if diagnosis.detectable is False:
        notice(f"no observer exists:\n{diagnosis.summary()}")
        if as_json:
            emit({"nodes": None, "decay_rate_measured": None, "final_error": None, "anchored": None})
        return FAILS
    with placed(given, "design"):
        observer = design(part.problem, method_of(choices, part.problem))
    designed = Design(given, part, choices, observer)
    _say_what_is_ignored(designed)
    with _places(out if prepare is None else prepare, allow_plain, kept=prepare is not None) as places:
        plan = plan_of(designed, section, places)
        _warn_of_plain_text(plan)
        if prepare is not None:
            return _prepared(plan, as_json)
        log = (file.parent if out is None else out) / "run.mcap"
        record = None if readings is None else _recorded(readings, speed, log, plan, designed)
        _set_aside(log)
        live = LiveRun(plan, None) if record is None else replayed(record, plan)
        live.observer = designed.programs
        live.keep(log_of(plan, log))  # only now: where the links cannot be opened, no log is left behind
        with watched(live, port if watch else None), _shown(live, as_json) as show:
            last = live.follow(seconds, show)
        facts = facts_of(live, last, designed.programs)
    for name in dict.fromkeys([*facts["dead"], *facts["silent"]]):
        notice(f"node {name} was not heard at the end; {live.supervisor.reason(name) or 'its process ran to the end'}")
    if live.trouble is not None:
        notice(f"the log ends early: {live.trouble}")
    if as_json:
        emit({**facts, "log": str(log)})
    else:
        _summarize(facts, log)
    return HOLDS if holds(facts) and live.trouble is None else FAILS


def changed_run(section: RunSection, **options: object) -> RunSection:
    """The run section with the command line's own options, checked like a file's."""
    return with_options(section, {key: value for key, value in options.items() if value is not None})


@contextmanager
def _places(out: Path | None, allow_plain: bool, *, kept: bool) -> Iterator[Places]:
    """The run's folders; socket files lie in a short temporary one, since their paths may not be long.

    That one is ``kept`` where nodes are to be started later.
    """
    sockets = Path(tempfile.mkdtemp(prefix="trigpoint-"))
    try:
        folder = sockets / "run" if out is None else out
        folder.mkdir(parents=True, exist_ok=True)
        (sockets / "watch").mkdir()
        yield Places(folder.absolute(), sockets, allow_plain)
    finally:
        if not kept:
            shutil.rmtree(sockets, ignore_errors=True)


def _prepared(plan: LivePlan, as_json: bool) -> int:
    plan.write()
    files = {node.name: str(plan.settings_file(k)) for k, node in enumerate(plan.nodes)}
    if as_json:
        emit({"nodes": files, "plant": str(plan.plant_file)})
    else:
        screen = console()
        for node in plan.nodes:
            screen.print(f"{node.name}: trigpoint node {files[node.name]}   (listens on {node.listen})")
        screen.print(f"plant: python -m trigpoint.runtime plant {plan.plant_file}")
    return HOLDS


def _set_aside(log: Path) -> None:
    """The log of an earlier run is kept, under the first number that is free."""
    if log.is_file():
        kept = next(name for k in count(1) if not (name := log.with_name(f"{log.stem}-{k}{log.suffix}")).exists())
        log.rename(kept)
        notice(f"the log of an earlier run is kept as {kept.name}")


def _recorded(path: Path, speed: float, log: Path, plan: LivePlan, designed: Design) -> Record:
    """The readings, with a word on what does not fit them."""
    if path.resolve() == log.resolve():
        raise ArgumentError(f"the run would write its log over its readings, {path}; give another --out")
    record = record_of(path, speed, plan)
    if record.silent:
        notice(f"{path} holds no readings of {len(record.silent)} arcs, which stay out: "
               f"{', '.join(map(str, record.silent[:12]))}")  # fmt: skip
    if speed != 1.0 and any(node.A.any() for node in designed.programs.nodes):
        notice(f"the agents move as fast as ever, their readings {speed:g} times as fast: the estimates will be off")
    return record


def _say_what_is_ignored(designed: Design) -> None:
    keys = ignored_troubles(designed)
    if keys:
        notice(f"[simulate] {', '.join(keys)}: not used, a live run has its own troubles")


def _warn_of_plain_text(plan: LivePlan) -> None:
    for address in (plan.listen, *(node.listen for node in plan.nodes)):
        warn_of(address)


@contextmanager
def _shown(live: LiveRun, as_json: bool) -> Iterator[Any]:
    """One line that changes, on a terminal; nothing elsewhere."""
    if as_json or not sys.stdout.isatty():
        yield lambda _: None
        return
    with Live(console=console(), transient=True, auto_refresh=False) as screen:
        yield lambda snapshot: screen.update(_line(snapshot, live), refresh=True)


def _line(snapshot: Snapshot, live: LiveRun) -> str:
    statuses = [status for status in snapshot.status if status is not None]
    own, joined = len(live.plan.nodes), len(live.supervisor.joined)
    error = float((snapshot.error[:own] ** 2).sum() ** 0.5)
    known = "error of some nodes not known" if error != error else f"error {error:.4g}"
    missed = sum(status.missed for status in statuses)
    dead = len(live.supervisor.dead)
    alive = [status for status, age in zip(snapshot.status, snapshot.age, strict=True) if age < 1.0]
    anchored = sum(status is not None and status.anchored for status in alive)
    came = f"   joined {joined}" if joined else ""
    return (
        f"{snapshot.time:7.1f} s   {known}   anchored {anchored} of {len(snapshot.names)}   "
        f"dead {dead}   restarts {live.supervisor.restarts}   missed {missed}{came}"
    )


def _summarize(facts: dict[str, Any], log: Path) -> None:
    table = Table(show_header=False, box=None, pad_edge=False)
    table.add_row("nodes", f"{facts['nodes']} in {facts['processes']} processes at {facts['rate']:g} Hz, "
                           f"{facts['seconds']:.1f} s")  # fmt: skip
    if facts["final_error"] is not None:
        share = facts["relative_error"]
        percent = "" if share is None else f" ({100.0 * share:.3g} % of |x|)"
        table.add_row("error norm", f"{facts['initial_error']:.4g} -> {facts['final_error']:.4g}{percent}")
    measured, predicted = _number(facts["decay_rate_measured"]), _number(facts["decay_rate_predicted"])
    ages = f"messages {1e3 * facts['message_age']:.1f} ms old, readings {1e3 * facts['reading_age']:.1f} ms"
    expected = _number(facts["decay_rate_expected"])
    text = f"measured {measured} /s, predicted {expected} /s from this start and {predicted} /s in the long run, {ages}"
    table.add_row("decay rate", text)
    if facts["readings"] is not None:
        table.add_row("recorded readings", str(facts["readings"]))
    table.add_row("anchored", f"{facts['anchored']} of {facts['nodes']} (guarantee covers {facts['covered']})")
    if facts["joined"]:
        table.add_row("joined meanwhile", ", ".join(facts["joined"]))
    table.add_row("restarts", f"{facts['restarts']}" + (f"; dead: {', '.join(facts['dead'])}" if facts["dead"] else ""))
    table.add_row("missed deadlines", f"{facts['missed']} of {facts['acts'] + facts['missed']}")
    table.add_row("a node takes", f"{100.0 * facts['cpu_per_node']:.2g} % of a core, {_number(facts['step_us'])} us a "
                                  f"step, {facts['memory_per_process'] / 2**20:.0f} MB a process")  # fmt: skip
    screen = console()
    screen.print(table)
    for text in facts["warnings"]:
        notice(f"warning: {text}")
    screen.print(f"written to {log}")


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.4g}"
