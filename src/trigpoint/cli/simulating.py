"""``trigpoint simulate``: watch the nodes converge."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from rich.table import Table

from trigpoint.analysis import diagnose
from trigpoint.arrays import at_least
from trigpoint.cli.choices import method_of
from trigpoint.cli.compose import Estimating, Given, Stated, changed, instants, part_of, read_any, with_options
from trigpoint.cli.designing import Gain, Margin, MaxNodes, MethodName, Rate, Weights, options_of, served
from trigpoint.cli.places import placed
from trigpoint.cli.shell import (
    FAILS,
    HOLDS,
    INTERRUPTED,
    Input,
    Json,
    Out,
    console,
    emit,
    ending,
    guarded,
    notice,
    tracked,
)
from trigpoint.cli.trouble import trouble_of
from trigpoint.estimation import estimate
from trigpoint.graphs import MeasurementGraph
from trigpoint.io import require_writer, save, write_atomically
from trigpoint.io.sections import SimulateSection
from trigpoint.methods import design
from trigpoint.model import Network, NetworkedAgents
from trigpoint.observers.assembled import Problem, channels_of
from trigpoint.observers.network import NetworkObserver
from trigpoint.observers.run import Run
from trigpoint.report import render, require_engines, run_page
from trigpoint.simulation import Noise, Scenario, simulate

Horizon = Annotated[float | None, typer.Option("--horizon", help="Simulated seconds.")]
Period = Annotated[float | None, typer.Option("--period", help="Seconds between exchanges; continuous if absent.")]
Seed = Annotated[int | None, typer.Option("--seed", help="Seed of everything random.")]


@guarded
def simulate_command(
    file: Input,
    method: MethodName = None,
    gain: Gain = None,
    margin: Margin = None,
    max_nodes: MaxNodes = None,
    weights: Weights = None,
    rate: Rate = None,
    horizon: Horizon = None,
    period: Period = None,
    seed: Seed = None,
    out: Out = None,
    as_json: Json = False,
) -> int:
    """Simulate the observer from a wrong start.

    On a measured network of constants the readings are those of the file, and the error is the distance from the
    least-squares answer. --out FILE.npz (.nc, .zarr) keeps the run, --out FILE.html writes a report.
    """
    ending(out, ".npz", ".nc", ".zarr", ".html")
    if out is not None:
        require_engines() if out.suffix.lower() == ".html" else require_writer(out)
    given = read_any(file)
    options = options_of(method=method, gain=gain, margin=margin, max_nodes=max_nodes, weights=weights, rate=rate)
    choices = changed(given.design, **options)
    part = part_of(given, choices)
    diagnosis = diagnose(part.problem)
    if diagnosis.detectable is False:
        notice(f"no observer exists:\n{diagnosis.summary()}")
        if as_json:
            emit({"path": None, "time_to_1_percent": None, "final_error": None, "decay_rate_measured": None})
        return FAILS
    with placed(given, "design", options):
        observer = design(part.problem, method_of(choices, part.problem))
    with placed(given, "simulate", options_of(horizon=horizon, period=period, seed=seed)):
        scenario = scenario_of(given, part, observer, _section(given.simulate, horizon, period, seed))
        run = simulate(served(part.problem, observer), observer, scenario, progress=tracked("simulating"))
    if out is not None:
        _write(out, run, given, part)
    _warn(given, part)
    if scenario.noise is None and run.error_norm[-1] > run.error_norm[0] > 0.0:
        notice(
            f"the error grew from {run.error_norm[0]:.4g} to {run.error_norm[-1]:.4g}: at this gain, period, delay or "
            "loss the observer need not converge; 'trigpoint certify' says what is guaranteed"
        )
    interrupted = bool(run.attributes.get("interrupted"))
    if interrupted:
        kept, asked = run.times.shape[0], scenario.times
        notice(f"interrupted: {kept} of {asked.shape[0]} samples are kept, up to {run.times[-1]:g} of {asked[-1]:g} s")
    if as_json:
        emit(facts(run, observer))
    else:
        _show(run, observer, given, out)
    return INTERRUPTED if interrupted else HOLDS


def _section(
    section: SimulateSection, horizon: float | None, period: float | None, seed: int | None
) -> SimulateSection:
    given: dict[str, Any] = {
        key: value for key, value in (("period", period), ("seed", seed), ("horizon", horizon)) if value is not None
    }
    kept = section if horizon is None else section.model_copy(update={"times": None})
    return with_options(kept, given)


def scenario_of(
    given: Given | Stated, part: Estimating, observer: NetworkObserver, section: SimulateSection
) -> Scenario:  # fmt: skip
    """The scenario of a file; recorded readings where the states are constants that were measured."""
    truth: Any = 0.0 if section.initial_state is None else section.initial_state
    measurements = None
    if isinstance(given, Given) and part.network is not None and given.agent.is_static:
        answer = estimate(part.network, uncertainty=False)
        truth, measurements = answer.x.reshape(part.network.graph.n_nodes, -1), part.network.values
    noise = Noise(section.noise.measurement, float(section.noise.process))
    return Scenario(
        instants(section, observer.decay_rate),
        1.0 if section.initial_error is None else section.initial_error,
        truth,
        period=section.period,
        noise=noise if noise.measurement or noise.process else None,
        **trouble_of(section, given.path, *_nodes_of(part.problem)),
        measurements=measurements,
        seed=section.seed,
        path=section.path,
        tolerance=section.tolerance,
    )


def _nodes_of(problem: Problem) -> tuple[tuple[str, ...], MeasurementGraph | None, int]:
    """Names, arcs and the number of states of a node."""
    channels = channels_of(problem)
    graph = problem.graph if isinstance(problem, NetworkedAgents) else None
    return channels.names, graph, max(target.shape[0] for target in channels.targets)


def _warn(given: Given | Stated, part: Estimating) -> None:
    """Say what would surprise in the numbers that follow."""
    if part.network is None or not isinstance(given, Given) or not isinstance(part.problem, NetworkedAgents):
        return
    if not given.agent.is_static:
        notice("the measured values of the file are not used: the agents move")
        return
    own = part.problem.graph.arc_weights
    blocks = own[:, None, None] * np.eye(part.network.dimension) if own.ndim == 1 else own
    covariance = 1.0 / own if part.network.values.ndim == 1 else np.linalg.inv(blocks)
    reached = estimate(Network(part.network.graph, part.network.values, covariance), uncertainty=False)
    gap = float(np.abs(reached.x - estimate(part.network, uncertainty=False).x).max())
    if gap > 1e-9 * float(np.abs(reached.x).max()):
        notice(
            f"with these weights the nodes tend to an answer {gap:.3g} {part.network.unit} from the least-squares one; "
            "--weights precision removes this"
        )


def facts(run: Run, observer: NetworkObserver) -> dict[str, Any]:
    """The JSON object of ``simulate``."""
    norm = run.error_norm
    return {
        "path": run.path,
        "time_to_1_percent": run.time_to(0.01 * float(norm[0])),
        "final_error": float(norm[-1]),
        "initial_error": float(norm[0]),
        "decay_rate_measured": run.measured_decay_rate(),
        "decay_rate": run.attributes["guaranteed_rate"],
        "spectral_abscissa": observer.spectral_abscissa,
        "horizon": float(run.times[-1]),
        "messages": int(run.messages[-1].sum()),
        "nodes": len(run.names),
        "interrupted": bool(run.attributes.get("interrupted")),
    }


def _write(out: Path, run: Run, given: Given | Stated, part: Estimating) -> None:
    if out.suffix.lower() == ".html":
        network = part.network
        positions = None if network is None or network.positions is None else network.positions
        if positions is not None and not np.isfinite(positions).all():
            positions = None
        page = run_page(
            run,
            title=f"Simulation of {given.path.name}",
            graph=part.graph,
            positions=positions,
            rate=run.attributes["guaranteed_rate"] or None,
            unit="" if network is None else network.unit,
        )
        write_atomically(out, render(page))
    else:
        save(run, out)


def _show(run: Run, observer: NetworkObserver, given: Given | Stated, out: Path | None) -> None:
    values = facts(run, observer)
    network = given.network if isinstance(given, Given) else None
    unit = "" if network is None or not network.unit else f" {network.unit}"
    table = Table(show_header=False, box=None, pad_edge=False)
    table.add_row("engine", f"{run.path}, {len(run.names)} nodes, {run.times[-1]:g} s")
    table.add_row("error norm", f"{values['initial_error']:.4g}{unit} -> {values['final_error']:.4g}{unit}")
    reached, sampled = values["time_to_1_percent"], run.attributes["period"] is not None
    table.add_row("time to 1 %", "not reached" if reached is None else f"{reached:.4g} s")
    measured = values["decay_rate_measured"]
    promise = f"guaranteed {at_least(observer.decay_rate, 5)} /s" + (" for continuous exchange only" if sampled else "")
    table.add_row("decay rate", f"measured {'-' if measured is None else format(measured, '.5g')} /s, {promise}")
    if values["messages"]:
        table.add_row("messages", f"{values['messages']}")
    screen = console()
    screen.print(table)
    if out is not None:
        screen.print(f"written to {out}")
