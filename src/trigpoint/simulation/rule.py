"""Which path runs a scenario: the inspectable rule."""

from __future__ import annotations

from trigpoint.errors import ArgumentError
from trigpoint.observers.network import DiffusiveObserver, NetworkObserver
from trigpoint.simulation.scenario import Scenario

MODAL_FROM = 200
"""Above so many states a continuous run of equal agents goes mode by mode: a dense exponential for every distinct step
between two output times is slower from there on."""


def chosen_path(scenario: Scenario, observer: NetworkObserver) -> str:
    """``reference``, ``stacked``, ``modal`` or ``gossip``, and why it must be so.

    ========================================================== ====================
    scenario                                                   ``auto`` takes
    ========================================================== ====================
    gossip                                                     ``gossip``
    losses, jitter, clocks, triggers, absences; or a topology
    that changes, with a period                                ``reference``
    continuous exchange with changes, noise or a motion        ``modal``
    continuous exchange, equal agents, above 200 states        ``modal``
    everything else, constant delays and rounding included     ``stacked``
    ========================================================== ====================

    Raises:
        ArgumentError: the path that was asked for cannot do what the scenario says.
    """
    wanted = scenario.path
    splits = isinstance(observer, DiffusiveObserver) and observer.graph.dimension == 1 and scenario.period is None
    if scenario.gossip:
        _only(wanted, "gossip", "gossip has a path of its own")
        return "gossip"
    if scenario.period is None and changes(scenario):
        if not splits:
            raise ArgumentError(
                "changes, noise and motion under continuous exchange are for equal agents with one gain and scalar "
                "weights; give a period"
            )
        _only(wanted, "modal", "continuous exchange with changes or noise goes mode by mode")
        return "modal"
    if wanted == "stacked" and scenario.needs_events:
        raise ArgumentError(
            "the stacked path knows no message loss, no jitter, no clocks that differ; use path='reference' or 'auto'"
        )
    if wanted == "modal" and not splits:
        raise ArgumentError(
            "the modal path is for equal agents with one gain, scalar weights and continuous exchange; use path='auto'"
        )
    if wanted != "auto":
        return wanted
    if scenario.needs_events:
        return "reference"
    large = isinstance(observer, DiffusiveObserver) and observer.states.total > MODAL_FROM
    return "modal" if splits and large else "stacked"


def changes(scenario: Scenario) -> bool:
    """True where a continuous run of ``scenario`` is not one linear equation from beginning to end."""
    always = scenario.topology is None and not scenario.absences and scenario.motion is None
    return not always or (scenario.noise is not None and (scenario.noise.measurement or scenario.noise.process) > 0.0)


def _only(wanted: str, path: str, why: str) -> None:
    if wanted not in ("auto", path):
        raise ArgumentError(f"{why}: use path='auto'; got path={wanted!r}")
