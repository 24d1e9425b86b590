"""Every experiment once a test process, and what is changed in each to see whether it notices."""

from __future__ import annotations

import functools
from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

from trigpoint.papers import EXPERIMENTS, Reproduction, reproduce

FAST: Mapping[str, dict[str, Any]] = MappingProxyType(
    {
        "g16-table1": {"samples": 100, "sizes": (30, 70, 80), "shares": (10, 60, 100)},
        "r23-symmetry": {"largest": 5},
    }
)
"""Options that make an experiment short enough for `make test`; the whole of it runs in a slow test."""

PERTURBED: Mapping[str, dict[str, Any]] = MappingProxyType(
    {
        "g16-example1": {"weight": 1.5},
        "g16-worst-case": {"nodes": 9},
        "g16-trees": {"weight": 1.01},
        "g16-theorem5": {"weight": 2.0},
        "g16-theorem6": {"margin": 0.98},
        "g16-table1": {"density": 0.8},
        "g16-altitude": {"rows": 5},
        "g16-riccati": {"acceleration": 2.0},
        "g16-moving": {"side": 1.0},
        "r23-cycles": {"rate": 1.0},
        "r23-symmetry": {"anchor": 0},
        "r23-image": {"gain": 900.0},
        "r23-tracking": {"gain": 1000.0},
        "w17-strong": {"scale": 1.1},
        "w17-components": {"rate": 0.5},
        "w17-silent": {"exchange": 0.06},
    }
)
"""One input changed in each experiment: a number must move and a verdict must turn."""


@functools.cache
def result_of(name: str) -> Reproduction:
    """The experiment as the paper has it (shortened where ``FAST`` says so), computed once."""
    return reproduce(name, **FAST.get(name, {}))


def perturbed(name: str) -> Reproduction:
    return reproduce(name, **{**FAST.get(name, {}), **PERTURBED[name]})


def at(result: Reproduction, place: str) -> float:
    """Our number at a place."""
    found = [cell.ours for cell in result.cells if cell.at == place]
    assert len(found) == 1, [cell.at for cell in result.cells]
    return found[0]


NAMES = tuple(EXPERIMENTS)
