"""Draw the README's picture: `python examples/picture.py docs/picture.svg` (without a name it only checks)."""

import sys
from pathlib import Path

import numpy as np

import trigpoint as tp
from trigpoint.io import write_atomically
from trigpoint.report import network_figure

DATA = Path(tp.__file__).parent / "cli" / "data" / "baumann.csv"

network = tp.load(DATA)
best = tp.estimate(network)
known = network.with_exact_readings_as_marks().known
svg = network_figure(
    network.graph,
    network.positions,
    np.where(best.sigma > 0, 1e3 * best.sigma, np.nan),
    label="standard deviation [mm]",
    known=known,
)
assert svg.startswith("<svg")
assert len(known) == 5
if len(sys.argv) > 1:
    write_atomically(sys.argv[1], svg)
