"""The list of commands."""

from __future__ import annotations

from typing import Annotated

import typer

from trigpoint import __version__
from trigpoint.cli.check import check
from trigpoint.cli.demo import demo
from trigpoint.cli.designing import certify_command, design_command, verify_command
from trigpoint.cli.estimating import estimate_command
from trigpoint.cli.keys import keys_command
from trigpoint.cli.nodes import node_command
from trigpoint.cli.others import convert
from trigpoint.cli.reporting import report
from trigpoint.cli.reproducing import reproduce_command
from trigpoint.cli.running import run_command
from trigpoint.cli.simulating import simulate_command
from trigpoint.cli.watching import watch

app = typer.Typer(
    name="trigpoint",
    help="Distributed state estimation from relative measurements.",
    epilog="Exit codes: 0 holds; 1 does not hold; 2 misuse or bad input; 3 cannot be decided.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
)


def _version(wanted: bool) -> None:
    if wanted:
        print(f"trigpoint {__version__}")
        raise typer.Exit


@app.callback()
def _root(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version and leave.")
    ] = False,
) -> None:
    """Say who can know what, design the estimator each node runs, prove it, simulate it."""


for _name, _command in (
    ("check", check),
    ("estimate", estimate_command),
    ("design", design_command),
    ("certify", certify_command),
    ("verify", verify_command),
    ("simulate", simulate_command),
    ("run", run_command),
    ("node", node_command),
    ("keys", keys_command),
    ("convert", convert),
    ("report", report),
    ("watch", watch),
    ("reproduce", reproduce_command),
    ("demo", demo),
):
    app.command(_name)(_command)
