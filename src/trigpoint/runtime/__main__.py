"""``python -m trigpoint.runtime node SETTINGS.json ...`` runs nodes in this process, ``plant PLANT.json`` a plant.

With ``--tied`` the process ends when its standard input does.
"""

from __future__ import annotations

import gc
import os
import sys
from collections.abc import Sequence
from functools import partial
from pathlib import Path

from trigpoint.errors import TrigpointError
from trigpoint.runtime.access import guest_rules
from trigpoint.runtime.clock import new_epoch, told_clock
from trigpoint.runtime.endpoints import is_local, parse_address, require_safe
from trigpoint.runtime.host import Host, Member
from trigpoint.runtime.machine import NodeMachine
from trigpoint.runtime.plant import PlantLoop, PlantSettings, read_plant
from trigpoint.runtime.settings import NodeSettings, read_settings
from trigpoint.runtime.transport import Transport
from trigpoint.runtime.zenoh_link import ZenohTransport, open_transport

_USAGE = "expected: python -m trigpoint.runtime [node SETTINGS.json ... | plant PLANT.json] [--tied]"


def main(arguments: Sequence[str]) -> int:
    """Run what the ``arguments`` say; 0 after an orderly end, 2 for misuse."""
    tied = "--tied" in arguments
    kind, *files = [text for text in arguments if text != "--tied"] or [""]
    try:
        if kind == "node" and files:
            run_nodes([(read_settings(Path(file)), Path(file)) for file in files], tied=tied)
        elif kind == "plant" and len(files) == 1:
            run_plant(read_plant(Path(files[0])), tied=tied)
        else:
            print(_USAGE, file=sys.stderr)
            return 2
    except TrigpointError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    return 0


def run_nodes(nodes: Sequence[tuple[NodeSettings, Path | None]], *, tied: bool) -> None:
    """Run the ``nodes`` (their settings, and the file to read them again from) until told to stop, or ``tied``.

    Settings that are read again may bring plain text beyond this machine only where it was there from the start.
    """
    clock, members = told_clock(os.environ), []
    for settings, path in nodes:
        machine = NodeMachine(settings, epoch=new_epoch(clock), now=clock.now())
        again = None if path is None else partial(reread, path, allow_plain=speaks_plainly(settings))
        members.append(Member(machine, open_transport, again))
    host = Host(members, clock)
    gc.collect()
    gc.freeze()  # what is there now lives as long as the process: no collection need look at it again
    host.run(tied=tied)
    if host.dropped:
        print(f"{host.dropped} frames were dropped: they came faster than they could be looked at", file=sys.stderr)


def speaks_plainly(settings: NodeSettings) -> bool:
    """Whether one of the addresses in ``settings`` is plain text that others can reach."""
    return any(not is_local(one) and not parse_address(one).secured for one in _addresses(settings))


def reread(path: Path, *, allow_plain: bool) -> NodeSettings:
    """The settings in the file at ``path``; plain text that leaves the machine only with ``allow_plain``.

    Raises:
        FileFormatError: the file is damaged.
        ArgumentError: an address does not fit, or is not allowed.
    """
    settings = read_settings(path)
    for address in _addresses(settings):
        require_safe(address, settings.identity, allow_plain=allow_plain)
    return settings


def _addresses(settings: NodeSettings) -> list[str]:
    return [address for address in (settings.listen, *settings.peers.values()) if address]


def run_plant(settings: PlantSettings, *, tied: bool) -> None:
    """Run the plant of these ``settings`` until told to stop, or ``tied`` until standard input ends."""
    transport, clock = plant_transport(settings), told_clock(os.environ)
    try:
        PlantLoop(settings, transport, clock, epoch=new_epoch(clock)).run(tied=tied)
    finally:
        transport.close()


def plant_transport(settings: PlantSettings) -> Transport:
    """The links of a plant: to the nodes of its ``settings``, which hear readings, and to whoever watches."""
    rules = None
    if settings.identity is not None:
        shown = {name for name, _ in settings.shows}
        roles = {name: "node" if name in shown else "supervisor" for name in settings.peers} | dict(settings.guests)
        rules = guest_rules(settings.network, "sensor", roles)
    return ZenohTransport(settings.listen, list(settings.peers.values()), identity=settings.identity, rules=rules)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
