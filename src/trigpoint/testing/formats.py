"""Axioms of a file format."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from trigpoint.io import Format, write_atomically
from trigpoint.model import Network


def check_format(file_format: Format, network: Network, folder: Path) -> None:
    """Write ``network`` and read it back: names, arcs and values must be the same, numbers to the last bit.

    Args:
        file_format: a format with ``read`` and ``write``.
        network: what to write; it must be something that the format can hold.
        folder: an existing folder for the file.
    """
    assert file_format.write is not None, f"{file_format.name} does not write"
    path = folder / f"conformance{file_format.suffixes[0]}"
    write_atomically(path, file_format.write(network))
    again = file_format.read(path)
    assert isinstance(again, Network), f"{file_format.name} read {type(again).__name__}"
    assert sorted(again.graph.names) == sorted(network.graph.names), "node names differ"
    assert _rows(again) == _rows(network), "arcs, values or variances differ"
    assert {again.graph.names[k] for k in again.known} == {network.graph.names[k] for k in network.known}


def _rows(network: Network) -> list[tuple[str, tuple[float, ...], bool]]:
    values = network.values.reshape(network.graph.n_arcs, -1)
    labels = [network.graph.arc_label(k) for k in range(network.graph.n_arcs)]
    return sorted(
        (label, tuple(np.asarray(value).tolist()), bool(exact))
        for label, value, exact in zip(labels, values, network.exact, strict=True)
    )
