"""``trigpoint keys``: certificates for links that are encrypted and closed to strangers."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from trigpoint.cli.compose import part_of, read_any
from trigpoint.cli.shell import HOLDS, Json, console, emit, guarded
from trigpoint.errors import ArgumentError
from trigpoint.observers.assembled import channels_of
from trigpoint.runtime import GUESTS, ROLES, find_identity, make_keys


@guarded
def keys_command(
    file: Annotated[Path | None, typer.Argument(help="Network or scenario whose nodes get certificates.")] = None,
    names: Annotated[list[str] | None, typer.Option("--name", help="A node; once for each, instead of FILE.")] = None,
    hosts: Annotated[
        list[str] | None, typer.Option("--host", help="A machine that nodes listen on, besides this one.")
    ] = None,
    guests: Annotated[
        list[str] | None, typer.Option("--guest", help=f"NAME=ROLE, once for each; roles: {', '.join(ROLES)}.")
    ] = None,
    out: Annotated[Path, typer.Option("--out", help="Folder for the files; made if it is missing.")] = Path("keys"),
    days: Annotated[int, typer.Option("--days", help="For how long the certificates hold.")] = 365,
    overwrite: Annotated[
        bool, typer.Option("--overwrite", help="Make everything afresh where files exist, the authority included.")
    ] = False,
    as_json: Json = False,
) -> int:
    """Make one authority and a certificate for every node and guest of a network, for tls and quic links.

    In a folder that holds an authority already, further names join it. Guests are plant, monitor and supervisor unless
    --guest names others.
    """
    nodes = _nodes(file, names or [])
    fresh = overwrite or not (out / "authority.pem").exists()
    roles = _roles(guests) if guests else dict(GUESTS if fresh else {})
    taken = [] if overwrite else [name for name in (*nodes, *roles) if _has_keys(out, name)]
    if taken:
        raise ArgumentError(
            f"{out} holds keys of {taken[0]!r} already; name another folder by --out, or make all keys afresh by "
            "--overwrite"
        )
    files = make_keys(out, nodes, hosts or (), guests=roles, days=days, overwrite=overwrite)
    made = {name: {"certificate": each.certificate, "key": each.key} for name, each in files.items()}
    authority = str(out / "authority.pem")
    if as_json:
        emit(
            {
                "folder": str(out),
                "authority": authority,
                "nodes": {name: made[name] for name in nodes},
                "guests": {name: {"role": role, **made[name]} for name, role in roles.items()},
                "days": days,
            }
        )
        return HOLDS
    screen = console()
    guests_said = ", ".join(f"{name} ({role})" for name, role in roles.items()) or "none"
    screen.print(f"{len(nodes)} nodes; guests: {guests_said}")
    screen.print(f"written to {out}; they hold for {days} days")
    screen.print(
        f"Every host needs {authority} and the two files of its own nodes; {out / 'authority.key'} stays here."
    )
    return HOLDS


def _has_keys(folder: Path, name: str) -> bool:
    try:
        find_identity(folder, name)
    except ArgumentError:
        return False
    return True


def _nodes(file: Path | None, names: list[str]) -> list[str]:
    """The nodes that estimate: a known mark runs no process."""
    if (file is None) == (not names):
        raise ArgumentError("name the nodes either by a network or scenario, or by --name once for each")
    if file is None:
        return names
    given = read_any(file)
    return list(channels_of(part_of(given, given.design).problem).names)


def _roles(guests: list[str]) -> dict[str, str]:
    pairs = [text.rpartition("=")[::2] for text in guests]
    for text, (name, role) in zip(guests, pairs, strict=True):
        if not name or role not in ROLES:
            raise ArgumentError(f"--guest must be NAME=ROLE with a role of {', '.join(ROLES)}; got {text!r}")
    if len(dict(pairs)) < len(pairs):
        raise ArgumentError(f"--guest names somebody twice: {', '.join(guests)}")
    return dict(pairs)
