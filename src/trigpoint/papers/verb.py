"""The verb ``reproduce`` and the list of experiments."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from types import MappingProxyType

from trigpoint.errors import ArgumentError
from trigpoint.papers import (
    g16_altitude,
    g16_example1,
    g16_moving,
    g16_riccati,
    g16_table1,
    g16_theorem5,
    g16_theorem6,
    g16_trees,
    g16_worst_case,
    r23_cycles,
    r23_image,
    r23_symmetry,
    r23_tracking,
    w17_components,
    w17_silent,
    w17_strong,
)
from trigpoint.papers.base import Reproduction

EXPERIMENTS: Mapping[str, Callable[..., Reproduction]] = MappingProxyType(
    {
        "g16-example1": g16_example1.run,
        "g16-worst-case": g16_worst_case.run,
        "g16-trees": g16_trees.run,
        "g16-theorem5": g16_theorem5.run,
        "g16-theorem6": g16_theorem6.run,
        "g16-table1": g16_table1.run,
        "g16-altitude": g16_altitude.run,
        "g16-riccati": g16_riccati.run,
        "g16-moving": g16_moving.run,
        "r23-cycles": r23_cycles.run,
        "r23-symmetry": r23_symmetry.run,
        "r23-image": r23_image.run,
        "r23-tracking": r23_tracking.run,
        "w17-strong": w17_strong.run,
        "w17-components": w17_components.run,
        "w17-silent": w17_silent.run,
    }
)
"""Every experiment by its name, in the order of the papers."""


def reproduce(name: str, **options: object) -> Reproduction:
    """Compute one experiment of a paper and return its published numbers beside ours.

    Args:
        name: one of ``trigpoint.papers.EXPERIMENTS``, for example ``"g16-example1"``.
        options: parameters of that experiment other than the paper's (gain, seed, size; ``help(EXPERIMENTS[name])``
            tells which there are).

    Raises:
        ArgumentError: no experiment has that name, or this one has no such option.

    >>> import trigpoint as tp
    >>> tp.reproduce("g16-example1").agrees
    True
    >>> tp.reproduce("g16-example1", weight=2.0).agrees
    False
    """
    if name not in EXPERIMENTS:
        raise ArgumentError(f"no experiment is called {name!r}; known are {', '.join(sorted(EXPERIMENTS))}")
    run = EXPERIMENTS[name]
    known = list(inspect.signature(run).parameters)
    strange = sorted(set(options) - set(known))
    if strange:
        raise ArgumentError(f"{name} has no option {strange[0]!r}; it has {', '.join(known) or 'none'}")
    return run(**options)
