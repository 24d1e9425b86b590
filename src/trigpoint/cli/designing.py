"""``trigpoint design``, ``certify`` and ``verify``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer
from rich.table import Table

from trigpoint.analysis import diagnose
from trigpoint.arrays import at_least, at_most, digest_of
from trigpoint.certificates import Certificate, certify, verify
from trigpoint.cli.asked import Asked, claims_for
from trigpoint.cli.choices import label_of, method_of
from trigpoint.cli.compose import changed, kind_of, part_of, read_any
from trigpoint.cli.places import placed
from trigpoint.cli.shell import FAILS, HOLDS, UNDECIDED, Input, Json, Out, console, emit, guarded, notice
from trigpoint.errors import FileFormatError
from trigpoint.io import load, parse_json, save
from trigpoint.io.text import read_text
from trigpoint.methods import design
from trigpoint.model import HyperNetwork, NetworkedAgents, SharedPlant
from trigpoint.observers.assembled import AssembledObserver, Problem
from trigpoint.observers.certificate import Outcome
from trigpoint.observers.network import DiffusiveObserver, NetworkObserver

_PROBLEMS = (NetworkedAgents, HyperNetwork, SharedPlant)
_OBSERVERS = (DiffusiveObserver, AssembledObserver)
CODE: dict[Outcome, int] = {"certified": HOLDS, "refuted": FAILS, "inconclusive": UNDECIDED}

MethodName = Annotated[str | None, typer.Option("--method", help="Design method (local-kalman).")]
Gain = Annotated[str | None, typer.Option("--gain", help="from-graph, worst-case, or a number.")]
Margin = Annotated[float | None, typer.Option("--margin", help="Factor above the gain bound (1.05).")]
MaxNodes = Annotated[int | None, typer.Option("--max-nodes", help="Largest network, for --gain worst-case.")]
Rate = Annotated[float | None, typer.Option("--rate", help="Decay rate asked for, 1/s (methods that take one).")]
Weights = Annotated[str | None, typer.Option("--weights", help="unit, or precision (1/sigma^2, mean 1).")]


@guarded
def design_command(
    file: Input,
    method: MethodName = None,
    gain: Gain = None,
    margin: Margin = None,
    max_nodes: MaxNodes = None,
    weights: Weights = None,
    rate: Rate = None,
    with_certificate: Annotated[bool, typer.Option("--certify", help="Prove the design, too.")] = False,
    out: Out = None,
    as_json: Json = False,
) -> int:
    """Design the observer that each node runs with its neighbours only.

    --out DIR writes problem.json, observer.json and (with --certify) certificate.json. Exit code 1: no observer
    exists, or a claim is refuted; 3: a claim is inconclusive.
    """
    given = read_any(file)
    options = options_of(method=method, gain=gain, margin=margin, max_nodes=max_nodes, weights=weights, rate=rate)
    choices = changed(given.design, **options)
    part = part_of(given, choices)
    diagnosis = diagnose(part.problem)
    if diagnosis.detectable is False:
        notice(f"no observer exists:\n{diagnosis.summary()}")
        if as_json:
            nothing = {"gain": None, "decay_rate": None, "spectral_abscissa": None, "certificate": {"verdict": None}}
            findings = [finding.text for finding in diagnosis.findings]
            emit({"method": label_of(choices, part.problem), **nothing, "findings": findings})
        return FAILS
    with placed(given, "design", options):
        observer = design(part.problem, method_of(choices, part.problem))
    bound = observer.facts.get("gain_bound")
    if isinstance(observer, DiffusiveObserver) and bound is not None and observer.decay_rate <= 0.0:
        notice(
            f"no decay is guaranteed at gain {observer.gain:.6g}; every gain above 1/lambda_min = {at_most(bound)} "
            "suffices (Theorem 4; --gain from-graph takes one)"
        )
    problem = served(part.problem, observer)
    certificate = certify(problem, observer) if with_certificate else None
    if out is not None:
        write_documents(out, problem, observer, certificate)
    if as_json:
        emit(facts(observer, certificate))
    else:
        _show(observer, certificate, part.marks, out)
    return HOLDS if certificate is None else CODE[certificate.verdict]


def options_of(**options: object) -> dict[str, object]:
    """The options that were given."""
    return {key: value for key, value in options.items() if value is not None}


def served(problem: Problem, observer: NetworkObserver) -> Problem:
    """The problem that the observer runs on: its own where all readings were brought to one place."""
    return observer.problem if isinstance(observer, AssembledObserver) else problem


def write_documents(folder: Path, problem: Problem, observer: NetworkObserver, certificate: Certificate | None) -> None:
    """Write the three documents side by side."""
    folder.mkdir(parents=True, exist_ok=True)
    save(problem, folder / "problem.json")
    save(observer, folder / "observer.json")
    if certificate is not None:
        save(certificate, folder / "certificate.json")
    elif (folder / "certificate.json").exists():
        notice(f"{folder / 'certificate.json'} belongs to an earlier design; --certify writes a new one")


def facts(observer: NetworkObserver, certificate: Certificate | None) -> dict[str, Any]:
    """The JSON object of ``design``."""
    known = {key: value for key, value in observer.facts.items() if isinstance(value, str | float | int | None)}
    return {
        "method": observer.method,
        "gain": observer.gain if isinstance(observer, DiffusiveObserver) else None,
        "decay_rate": observer.decay_rate,
        "spectral_abscissa": observer.spectral_abscissa,
        "nodes": len(observer.names),
        "facts": known,
        "certificate": {"verdict": None if certificate is None else certificate.verdict},
    }


def _show(observer: NetworkObserver, certificate: Certificate | None, marks: int, out: Path | None) -> None:
    screen = console()
    table = Table(show_header=False, box=None, pad_edge=False)
    table.add_row("method", observer.method)
    table.add_row("estimating nodes", f"{len(observer.names)}" + (f" ({marks} known)" if marks else ""))
    if isinstance(observer, DiffusiveObserver):
        table.add_row("gain", f"{observer.gain:.10g}  ({observer.facts.get('gain_rule', 'given')})")
    rate = f"{at_least(observer.decay_rate)} /s" if observer.decay_rate > 0 else "none (no decay is guaranteed)"
    table.add_row("guaranteed decay rate", rate)
    if observer.spectral_abscissa is not None:
        table.add_row("computed spectral abscissa", f"{observer.spectral_abscissa:.6g} /s")
    residuals = observer.verify_design_equations() if len(observer.names) <= 2000 else None
    if residuals is not None:
        table.add_row("design equations", f"residuals {residuals.dynamics:.1e}, {residuals.output:.1e}")
    screen.print(table)
    if certificate is not None:
        screen.print(f"\ncertificate: {certificate.verdict}", style="bold")
        screen.print(certificate.summary())
    if out is not None:
        screen.print(f"\nwritten to {out}")


@guarded
def certify_command(
    file: Annotated[Path, typer.Argument(help="An observer.json written by design.")],
    rate: Annotated[float | None, typer.Option("--rate", help="Prove this decay rate, 1/s, not the design's.")] = None,
    period: Annotated[
        float | None, typer.Option("--period", help="Also: stable with an exchange every so many seconds.")
    ] = None,
    delay: Annotated[
        float | None, typer.Option("--delay", help="Also: stable with this constant delay, seconds.")
    ] = None,
    arrival: Annotated[
        float | None,
        typer.Option("--arrival", help="Also: stable in mean square with this chance of an arc (needs --period)."),
    ] = None,
    max_nodes: Annotated[
        int | None, typer.Option("--max-nodes", help="Also: stable under switching among networks of so many nodes.")
    ] = None,
    floor: Annotated[
        float | None, typer.Option("--floor", help="Also: stable under switching with no eigenvalue below this.")
    ] = None,
    ceiling: Annotated[
        float | None, typer.Option("--ceiling", help="Also: stable under switching with no eigenvalue above this.")
    ] = None,
    mu: Annotated[
        float | None, typer.Option("--mu", help="Also: bounds of the steady error at this noise level.")
    ] = None,
    process: Annotated[
        float | None, typer.Option("--process", help="Also: node by node, at this level of the agents' noise.")
    ] = None,
    measurement: Annotated[
        float | None, typer.Option("--measurement", help="Also: node by node, at this level of the readings' noise.")
    ] = None,
    observable: Annotated[
        bool, typer.Option("--observable", help="Also: the readings determine every state, exactly.")
    ] = False,
    out: Out = None,
    as_json: Json = False,
) -> int:
    """Prove what an observer guarantees; --out FILE writes the certificate."""
    observer = load(file)
    if not isinstance(observer, DiffusiveObserver | AssembledObserver):
        raise FileFormatError(file, f"holds {kind_of(observer)}; expected an observer (written by design --out)")
    asked = Asked(rate, floor, ceiling, max_nodes, period, delay, arrival, mu, process, measurement, observable)
    claims = claims_for(observer, asked)
    certificate = certify(observer.problem, observer, claims)
    if out is not None:
        save(certificate, out)
        notice(f"written to {out}; verify looks for problem.json and observer.json beside it")
    if as_json:
        emit({"verdict": certificate.verdict, "claims": _claims(certificate)})
    else:
        console().print(certificate.summary())
    return CODE[certificate.verdict]


@guarded
def verify_command(
    file: Annotated[Path, typer.Argument(help="A certificate.json, beside its problem.json and observer.json.")],
    as_json: Json = False,
) -> int:
    """Check a certificate again, from its witnesses alone.

    Exit code 0: certified; 1: refuted; 3: inconclusive; 2: malformed, changed, or for another observer.
    """
    file = file / "certificate.json" if file.is_dir() else file
    certificate = load(file)
    if not isinstance(certificate, Certificate):
        raise FileFormatError(
            file, f"holds {kind_of(certificate)}; expected a certificate (written by design --certify)"
        )
    problem = _beside(file, "problem", certificate.problem_digest, _PROBLEMS)
    observer = _beside(file, "observer", certificate.observer_digest, _OBSERVERS)
    verdict = verify(certificate, problem, observer)
    if as_json:
        pairs = zip(verdict.claims, verdict.numbers, strict=True)
        claims = [{"claim": name, "verdict": outcome, "numbers": dict(found)} for (name, outcome), found in pairs]
        emit({"verdict": verdict.outcome, "claims": claims})
    else:
        console().print(verdict.summary())
    return CODE[verdict.outcome]


def _claims(certificate: Certificate) -> list[dict[str, Any]]:
    return [
        {"claim": record.claim, "verdict": record.verdict, "text": record.text, "numbers": dict(record.numbers)}
        for record in certificate.records
    ]


def _beside(certificate: Path, what: str, digest: str, kinds: tuple[type, ...]) -> Any:
    """The document of that name beside the certificate, if it is of that kind and its digest the named one."""
    path = certificate.with_name(f"{what}.json")
    if not path.exists():
        raise FileFormatError(path, f"is missing: a certificate is checked against the {what} beside it")
    loaded = load(path)
    try:
        found = digest_of(parse_json(read_text(path), path))  # of what stands there, unknown fields included
    except (RecursionError, ValueError) as error:
        raise FileFormatError(path, f"holds something that JSON has no word for ({error})") from error
    if found != digest or not isinstance(loaded, kinds):
        raise FileFormatError(path, f"is not the {what} that the certificate names (its digest differs)")
    return loaded
