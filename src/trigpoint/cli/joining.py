"""``trigpoint node --new`` and ``--gone``: the files with which a node joins a network that runs, or has left it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from trigpoint.cli.shell import HOLDS, console, emit
from trigpoint.errors import ArgumentError
from trigpoint.runtime.endpoints import require_safe
from trigpoint.runtime.keys import find_identity
from trigpoint.runtime.newcomer import Newcomer, join, leave
from trigpoint.runtime.settings import Identity, NodeSettings, read_settings, write_all
from trigpoint.runtime.topics import written


@dataclass(frozen=True)
class Joining:
    """What the command line says about a newcomer.

    Attributes:
        newcomer: who joins; its certificates are found later.
        beside: its neighbours' files.
        keys: where its certificates lie; None for the neighbours' folder.
        out: where the files go; None for the neighbours' own places.
        allow_plain: whether plain text may leave the machine.
    """

    newcomer: Newcomer
    beside: tuple[Path, ...]
    keys: Path | None
    out: Path | None
    allow_plain: bool


def joined(wish: Joining, *, as_json: bool) -> int:
    """Write the newcomer's file and its neighbours' new ones, all or none."""
    neighbours = [read_settings(file) for file in wish.beside]
    identity = _identity(wish, neighbours)
    newcomer = replace(wish.newcomer, identity=identity)
    own, grown = join(newcomer, neighbours)
    require_safe(newcomer.listen, identity, allow_plain=wish.allow_plain)
    places = [file if wish.out is None else wish.out / file.name for file in wish.beside]
    place = places[0].with_name(f"{written(newcomer.name)}.json")
    if place.exists() or len({*places, place}) <= len(places):
        raise ArgumentError(f"{place} exists, or two files would have one name; choose another --out")
    if wish.out is not None:
        wish.out.mkdir(parents=True, exist_ok=True)
    write_all([(own, place), *zip(grown, places, strict=True)])
    if as_json:
        emit({"newcomer": str(place), "neighbours": {one.name: str(p) for one, p in zip(grown, places, strict=True)}})
        return HOLDS
    screen = console()
    for one, file in zip(grown, places, strict=True):
        screen.print(f"{one.name}: {file}   (send its process SIGHUP)")
    screen.print(f"{own.name}: trigpoint node {place}")
    return HOLDS


def left(name: str, beside: Sequence[Path], out: Path | None, *, as_json: bool) -> int:
    """Write the neighbours' files without the node ``name``, all or none."""
    shrunk = leave(name, [read_settings(file) for file in beside])
    places = [file if out is None else out / file.name for file in beside]
    if len(set(places)) < len(places):
        raise ArgumentError("two of the files would have one name in --out; give them other names")
    if out is not None:
        out.mkdir(parents=True, exist_ok=True)
    write_all(list(zip(shrunk, places, strict=True)))
    if as_json:
        emit({"neighbours": {one.name: str(place) for one, place in zip(shrunk, places, strict=True)}})
        return HOLDS
    for one, place in zip(shrunk, places, strict=True):
        console().print(f"{one.name}: {place}   (send its process SIGHUP)")
    return HOLDS


def _identity(wish: Joining, neighbours: list[NodeSettings]) -> Identity | None:
    known = next((one.identity for one in neighbours if one.identity is not None), None)
    if known is None:
        if wish.keys is not None:
            raise ArgumentError("--keys: the neighbours' links are plain and show no certificate; leave it out")
        return None
    folder = Path(known.authority).parent if wish.keys is None else wish.keys
    return find_identity(folder, wish.newcomer.name)
