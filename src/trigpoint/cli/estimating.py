"""``trigpoint estimate``: the best static answer."""

from __future__ import annotations

import csv
import io
from dataclasses import asdict
from typing import Annotated, Any

import numpy as np
import typer
from rich.table import Table

from trigpoint.cli.compose import measured, read
from trigpoint.cli.shell import FAILS, HOLDS, Input, Json, Out, console, emit, ending, guarded
from trigpoint.estimation import Estimate, estimate
from trigpoint.io import write_atomically
from trigpoint.model import Network

_ROWS = 60


@guarded
def estimate_command(
    file: Input,
    a_priori: Annotated[bool, typer.Option("--a-priori", help="Keep the stated sigmas; do not scale by m0.")] = False,
    out: Out = None,
    as_json: Json = False,
) -> int:
    """Solve the network by weighted least squares, with standard deviations and suspects.

    Where sigmas are stated, the global test says whether m0 fits them. --out writes a CSV table of the nodes. Exit code
    1: some component has no absolute reading (its values are relative to its first node).
    """
    ending(out, ".csv")
    network = measured(read(file))
    answer = estimate(network, a_priori=a_priori)
    if out is not None:
        write_atomically(out, _csv(answer))
    if as_json:
        emit(facts(network, answer))
    else:
        _show(network, answer)
    return HOLDS if (answer.reference < 0).all() else FAILS


def facts(network: Network, answer: Estimate) -> dict[str, Any]:
    """The JSON object of ``estimate``."""
    x, sigma = _columns(answer)
    return {
        "estimates": {
            name: {"value": value, "sigma": spread, "status": str(status)}
            | ({} if reference < 0 else {"reference": answer.names[reference]})
            for name, value, spread, status, reference in zip(
                answer.names, x, sigma, answer.status, answer.reference.tolist(), strict=True
            )
        },
        "variance_factor": answer.variance_factor,
        "degrees_of_freedom": answer.degrees_of_freedom,
        "sigma_kind": answer.sigma_kind,
        "sigma_assumed": network.covariance is None,
        "unit": network.unit,
        "suspects": [
            {"row": k, "arc": network.graph.arc_label(k), "standardized": score}
            for k, score in zip(answer.suspects, answer.suspect_scores.tolist(), strict=True)
        ],
        "suspects_kind": answer.suspects_kind,
        "global_test": _test(answer),
    }


def _test(answer: Estimate) -> dict[str, Any] | None:
    test = answer.global_test
    return None if test is None else {**asdict(test), "passes": test.passes}


def _columns(answer: Estimate) -> tuple[np.ndarray, np.ndarray]:
    count = len(answer.names)
    return answer.x.reshape(count, -1), answer.sigma.reshape(count, -1)


def _csv(answer: Estimate) -> str:
    x, sigma = _columns(answer)
    width = x.shape[1]
    axes = [""] if width == 1 else [f"_{'xyz'[k] if width <= 3 else k}" for k in range(width)]
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["node", *(f"value{a}" for a in axes), *(f"sigma{a}" for a in axes), "status"])
    for name, value, spread, status in zip(answer.names, x.tolist(), sigma.tolist(), answer.status, strict=True):
        writer.writerow([name, *map(repr, value), *map(repr, spread), status])
    return text.getvalue()


def _show(network: Network, answer: Estimate) -> None:
    out = console()
    unit = f" [{network.unit}]" if network.unit else ""
    table = Table("node", f"value{unit}", f"sigma{unit}", "status", box=None, pad_edge=False)
    x, sigma = _columns(answer)
    for name, value, spread, status in list(zip(answer.names, x, sigma, answer.status, strict=True))[:_ROWS]:
        table.add_row(
            name, " ".join(f"{v:.6f}" for v in value), " ".join(f"{s:.2e}" for s in spread), str(status)
        )  # fmt: skip
    out.print(table)
    if len(answer.names) > _ROWS:
        out.print(f"... and {len(answer.names) - _ROWS} more nodes (--out FILE.csv writes all)")
    factor = "none" if answer.variance_factor is None else f"{np.sqrt(answer.variance_factor):.6f}"
    out.print(
        f"\ndegrees of freedom {answer.degrees_of_freedom}, a-posteriori m0 {factor}; sigmas are {answer.sigma_kind}"
    )
    if network.covariance is None:
        out.print("the file has no sigma: sigma 1 is assumed for every difference, so that only ratios have a meaning")
    if answer.global_test is not None:
        out.print(answer.global_test.text)
    by = "by the stated sigmas" if answer.suspects_kind == "a-priori" else "by m0"
    for k, score in zip(answer.suspects, answer.suspect_scores.tolist(), strict=True):
        out.print(f"suspect: {network.graph.arc_label(k)}, standardized residual {score:.2f} ({by})")
    for node in np.unique(answer.reference[answer.reference >= 0]).tolist():
        out.print(f"no absolute reading in the component of {answer.names[node]}: values are relative to it")
