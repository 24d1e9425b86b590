"""The verb ``reproduce`` and the list of experiments."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType

from trigpoint.errors import ArgumentError
from trigpoint.papers import g16_example1, g16_riccati, g16_worst_case
from trigpoint.papers.base import Reproduction

EXPERIMENTS: Mapping[str, Callable[[], Reproduction]] = MappingProxyType(
    {
        "g16-example1": g16_example1.run,
        "g16-riccati": g16_riccati.run,
        "g16-worst-case": g16_worst_case.run,
    }
)


def reproduce(name: str) -> Reproduction:
    """Compute one experiment of a paper and return its published numbers beside ours.

    Args:
        name: one of ``trigpoint.papers.EXPERIMENTS``, for example ``"g16-example1"``.

    Raises:
        ArgumentError: no experiment has that name.

    >>> import trigpoint as tp
    >>> tp.reproduce("g16-example1").agrees
    True
    """
    if name not in EXPERIMENTS:
        raise ArgumentError(f"no experiment is called {name!r}; known are {', '.join(sorted(EXPERIMENTS))}")
    return EXPERIMENTS[name]()
