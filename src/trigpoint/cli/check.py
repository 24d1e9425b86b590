"""``trigpoint check``: can every node know its state?"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from rich.table import Table

from trigpoint.analysis import (
    Contingency,
    Critical,
    Diagnosis,
    EigenvalueBound,
    Recommendation,
    agent_knowledge,
    critical,
    diagnose,
    gain_bound,
    recommend_anchors,
    smallest_eigenvalue,
    without_each,
    worst_case_gain,
)
from trigpoint.arrays import at_least, at_most
from trigpoint.cli.compose import Given, estimating, read
from trigpoint.cli.shell import FAILS, HOLDS, UNDECIDED, Input, Json, console, emit, guarded, notice
from trigpoint.graphs import MeasurementGraph
from trigpoint.io import ScenarioFile, load
from trigpoint.model import SharedPlant

_VERDICT = {True: "observable", False: "unobservable", None: "undecided"}
_CODE = {True: HOLDS, False: FAILS, None: UNDECIDED}
_SHOWN = 20

Weighted = Annotated[
    bool, typer.Option("--weighted", help="Use 1/sigma^2 as arc weights (mean 1); exactly known nodes are left out.")
]


Recommend = Annotated[int, typer.Option("--recommend", min=0, help="Recommend this many anchors to add.")]
WhatIf = Annotated[bool, typer.Option("--what-if", help="Lose each arc and each anchor in turn, the worst first.")]


@guarded
def check(
    file: Input,
    weighted: Weighted = False,
    recommend: Recommend = 0,
    what_if: WhatIf = False,
    as_json: Json = False,
) -> int:
    """Say whether every node can know its state, why not, what to add; and which gain the network needs.

    Arcs and anchors that must not fail are named. Exit code 0: observable; 1: not; 3: undecided at this precision.
    """
    plant = _plant_of(file)
    if plant is not None:
        return _check_plant(plant, as_json)
    given = read(file)
    graph = (estimating(given, "precision").graph if weighted else None) or given.graph
    diagnosis = diagnose(given.problem)
    bound = smallest_eigenvalue(graph)
    weak = critical(given.graph)
    advice = recommend_anchors(graph, recommend) if recommend else None
    study = without_each(graph) if what_if and graph.is_externally_connected else None
    if as_json:
        further = {"recommendation": _recommended(advice), "what_if": _losses(graph, study)}
        emit({**facts(given.graph, diagnosis, bound), "critical": _weak_points(weak), **further})
    else:
        parts = [part.summary() for part in (weak, advice) if part is not None]
        parts += [] if study is None else [study.summary(_SHOWN)]
        _show(given, diagnosis, bound)
        console().print("".join(f"\n{part}\n" for part in parts), end="")
    if what_if and study is None:
        notice("--what-if is left out: some nodes have no path to an anchor even while nothing is lost (see above)")
    return _CODE[diagnosis.observable]


def _plant_of(file: Path) -> SharedPlant | None:
    loaded = load(file) if file.suffix.lower() == ".toml" else None
    return loaded.plant if isinstance(loaded, ScenarioFile) else None


def _check_plant(plant: SharedPlant, as_json: bool) -> int:
    diagnosis = diagnose(plant)
    knowledge = agent_knowledge(plant)
    if as_json:
        emit(
            {
                "agents": len(plant.outputs),
                "states": plant.A.shape[0],
                "verdict": _VERDICT[diagnosis.observable],
                "detectable": diagnosis.detectable,
                "theorem": diagnosis.theorem,
                "known_dimensions": [known.dimension for known in knowledge],
                "findings": [vars(finding) | {"direction": None} for finding in diagnosis.findings],
            }
        )
    else:
        console().print(diagnosis.summary())
    return _CODE[diagnosis.observable]


def _weak_points(weak: Critical) -> dict[str, Any]:
    def listed(arcs: np.ndarray, losses: np.ndarray) -> list[dict[str, Any]]:
        return [
            {"row": arc, "arc": weak.graph.arc_label(arc), "floating": loss}
            for arc, loss in zip(arcs.tolist(), losses.tolist(), strict=True)
        ]

    return {
        "arcs": listed(weak.arcs, weak.arc_losses),
        "anchors": listed(weak.anchors, weak.anchor_losses),
        "single_anchor_components": weak.single_anchor.tolist(),
        "redundant_arcs": int(weak.redundant.shape[0]),
    }


def _recommended(found: Recommendation | None) -> list[dict[str, Any]] | None:
    if found is None:
        return None
    return [
        {"node": found.graph.names[node], "lambda_min": value, "gain_bound": gain}
        for node, value, gain in zip(found.nodes, found.eigenvalues.tolist(), found.gain_bounds.tolist(), strict=True)
    ]


def _losses(graph: MeasurementGraph, study: Contingency | None) -> list[dict[str, Any]] | None:
    if study is None:
        return None
    return [
        {
            "row": int(arc),
            "arc": graph.arc_label(int(arc)),
            "lambda_min": float(study.eigenvalue[k]),
            "gain_bound": float(study.gain_bound[k]),
            "deviation_increase": float(study.deviation_increase[k]),
            "floating": int(study.floating[k]),
        }
        for k, arc in enumerate(study.arcs)
    ]


def facts(graph: MeasurementGraph, diagnosis: Diagnosis, bound: EigenvalueBound) -> dict[str, Any]:
    """The JSON object of ``check``."""
    return {
        "nodes": graph.n_nodes,
        "arcs": graph.n_arcs,
        "anchors": int(graph.is_external.sum()),
        "components": [
            {"nodes": [graph.names[k] for k in nodes.tolist()], "anchored": bool(anchored)}
            for nodes, anchored in zip(graph.components, graph.component_is_anchored, strict=True)
        ],
        "verdict": _VERDICT[diagnosis.observable],
        "detectable": diagnosis.detectable,
        "theorem": diagnosis.theorem,
        "findings": [
            {
                "kind": finding.kind,
                "nodes": [graph.names[k] for k in finding.nodes],
                "text": finding.text,
                "remedy": finding.remedy,
            }
            for finding in diagnosis.findings
        ],
        "lambda_min": {"value": bound.value, "lower": bound.lower, "upper": bound.upper},
        "gain_bound": gain_bound(bound),
        "worst_case_gain": worst_case_gain(graph.n_nodes),
    }


def network_table(graph: MeasurementGraph) -> Table:
    """Nodes, arcs, anchors and components, as a table for people."""
    anchored = int(np.count_nonzero(graph.component_is_anchored))
    table = Table(show_header=False, box=None, pad_edge=False)
    inner = graph.n_arcs - int(graph.is_external.sum())
    table.add_row("nodes", f"{graph.n_nodes}")
    table.add_row("arcs", f"{graph.n_arcs} ({inner} differences, {graph.n_arcs - inner} absolute)")
    table.add_row("anchored nodes", f"{graph.anchored_nodes.shape[0]}")
    table.add_row("components", f"{len(graph.component_is_anchored)} ({anchored} anchored)")
    table.add_row("externally connected", "yes" if graph.is_externally_connected else "no")
    return table


def gain_table(graph: MeasurementGraph, bound: EigenvalueBound) -> Table:
    """``lambda_min`` with its bounds and the gains that follow."""
    table = Table(show_header=False, box=None, pad_edge=False)
    table.add_row("lambda_min", f"{bound.value:.12g}")
    table.add_row("  rigorous bounds", f"[{at_least(bound.lower, 15)}, {at_most(bound.upper, 15)}]", style="dim")
    if bound.lower > 0:
        table.add_row("gain bound 1/lambda_min", at_most(gain_bound(bound)))
    table.add_row(f"worst-case gain of {graph.n_nodes} nodes", f"{worst_case_gain(graph.n_nodes):.10g}")
    return table


def _show(given: Given, diagnosis: Diagnosis, bound: EigenvalueBound) -> None:
    out = console()
    out.print(network_table(given.graph))
    words = {True: "yes", False: "no", None: "cannot be decided at this precision"}
    out.print(f"\nCan every node know its state? {words[diagnosis.observable]}  ({diagnosis.theorem})", style="bold")
    for finding in diagnosis.findings[:_SHOWN]:
        out.print(f"  - {finding.text}\n    {finding.remedy}")
    if len(diagnosis.findings) > _SHOWN:
        out.print(f"  ... and {len(diagnosis.findings) - _SHOWN} more findings (--json lists all)")
    out.print()
    out.print(gain_table(given.graph, bound))
