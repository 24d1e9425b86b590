"""``trigpoint node``: one node on its own host; and the files with which a new one joins."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from trigpoint.cli.joining import Joining, joined, left
from trigpoint.cli.shell import HOLDS, Json, guarded, notice
from trigpoint.errors import ArgumentError
from trigpoint.runtime.__main__ import run_nodes
from trigpoint.runtime.endpoints import is_local, parse_address, require_safe
from trigpoint.runtime.newcomer import Newcomer
from trigpoint.runtime.settings import NodeSettings, read_settings

_BOTH = ("--beside", "--out", "--json")
Plain = Annotated[bool, typer.Option("--allow-plain", help="Allow plain text on addresses beyond this machine.")]


@guarded
def node_command(
    files: Annotated[list[Path] | None, typer.Argument(help="Settings of nodes, written by run --prepare.")] = None,
    listen: Annotated[
        str | None, typer.Option("--listen", help="Listen on this address instead; with --new, the newcomer's.")
    ] = None,
    peer: Annotated[list[str] | None, typer.Option("--peer", help="NAME=ADDRESS of a neighbour to connect to.")] = None,
    allow_plain: Plain = False,
    new: Annotated[str | None, typer.Option("--new", help="Run nothing: write the files of a new node.")] = None,
    gone: Annotated[
        str | None,
        typer.Option("--gone", help="Run nothing: write files without a node that left for good."),
    ] = None,
    beside: Annotated[list[Path] | None, typer.Option("--beside", help="New, gone: the file of a neighbour.")] = None,
    label: Annotated[
        list[int] | None, typer.Option("--label", help="New: number of the reading to each neighbour, in order.")
    ] = None,
    anchor_label: Annotated[int | None, typer.Option("--anchor-label", help="New: of its absolute reading.")] = None,
    deviation: Annotated[
        float | None, typer.Option("--deviation", help="New: standard deviation of its readings.")
    ] = None,
    sensor: Annotated[
        str | None, typer.Option("--sensor", help="New: who publishes its readings, if not a sensor known already.")
    ] = None,
    nodes: Annotated[
        int | None, typer.Option("--nodes", help="New: nodes in the network then; one more than known if absent.")
    ] = None,
    keys: Annotated[
        Path | None, typer.Option("--keys", help="New: folder of its certificate; the neighbours' if absent.")
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option("--out", help="New, gone: folder for the files; if absent, the neighbours' are replaced."),
    ] = None,
    as_json: Json = False,
) -> int:
    """Run one node on its own host (or several in one process), until SIGTERM or Ctrl-C; SIGHUP reads the files again.

    The node finds its neighbours at the addresses in its settings; --listen and --peer replace them.

    With --new NAME a node joins a network that runs, whose gain serves every network of its nodes: its file and its
    neighbours' new ones are written, from the neighbours' files alone. SIGHUP makes the neighbours take theirs. With
    --gone NAME the neighbours' files are written without a node that left for good.
    """
    if new is not None and gone is not None:
        raise ArgumentError("--new and --gone are two things: give one of them")
    if new is not None:
        if files or peer or listen is None:
            raise ArgumentError("--new needs --listen ADDRESS, and takes no files and no --peer: it runs nothing")
        newcomer = Newcomer(new, listen, tuple(label or ()), anchor_label, deviation, sensor, nodes)
        return joined(Joining(newcomer, tuple(beside or ()), keys, out, allow_plain), as_json=as_json)
    if gone is not None:
        news = label, anchor_label, deviation, sensor, nodes, keys
        if files or peer or listen is not None or any(one is not None for one in news):
            raise ArgumentError("--gone takes --beside, --out and --json only: it runs nothing")
        return left(gone, beside or [], out, as_json=as_json)
    options = {
        "--beside": beside, "--label": label, "--anchor-label": anchor_label, "--deviation": deviation,
        "--sensor": sensor, "--nodes": nodes, "--keys": keys, "--out": out, "--json": as_json or None,
    }  # fmt: skip
    given = [name for name, value in options.items() if value is not None]
    if given:
        raise ArgumentError(f"{given[0]} belongs to --new NAME" + (" or --gone NAME" if given[0] in _BOTH else ""))
    if not files:
        raise ArgumentError("name the settings of a node (run --prepare writes them), or a new one with --new NAME")
    settings = [_changed(file, listen, peer or [], len(files), allow_plain=allow_plain) for file in files]
    _say_where([one for one, _ in settings])
    run_nodes(settings, tied=False)
    return HOLDS


def _say_where(settings: list[NodeSettings]) -> None:
    """For whoever sits before a terminal: a node says nothing else while all is well."""
    for one in settings if sys.stderr.isatty() else ():
        heard = ", ".join(one.program.hears) or "nobody"
        notice(f"node {one.name} listens on {one.listen} and hears {heard}; Ctrl-C ends it")


def _changed(
    file: Path, listen: str | None, peer: list[str], count: int, *, allow_plain: bool
) -> tuple[NodeSettings, Path | None]:
    """The settings in ``file`` with other addresses; and the file, to be read again, where nothing is other."""
    peers = dict(_pair(text) for text in peer)
    settings = read_settings(file)
    strangers = sorted(set(peers) - set(settings.program.hears) - set(settings.peers))
    if strangers:
        raise ArgumentError(f"--peer names {strangers[0]!r}, no neighbour of {settings.name!r}")
    if listen is not None and count > 1:
        raise ArgumentError("--listen is one address; give one file with it")
    settings = replace(
        settings, listen=settings.listen if listen is None else listen, peers={**settings.peers, **peers}
    )  # fmt: skip
    for address in (settings.listen, *settings.peers.values()):
        if address:
            require_safe(address, settings.identity, allow_plain=allow_plain)
            warn_of(address)
    return settings, None if listen is not None or peers else file


def _pair(text: str) -> tuple[str, str]:
    name, equals, address = text.rpartition("=")
    if not equals or not name:
        raise ArgumentError(f"--peer: got {text!r}, expected NAME=ADDRESS")
    parse_address(address)
    return name, address


def warn_of(address: str) -> None:
    """Say so where an ``address`` is plain text that leaves this machine."""
    if not is_local(address) and not parse_address(address).secured:
        notice(f"warning: {address} is plain text that others in the network can read and forge")
