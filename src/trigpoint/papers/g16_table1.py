"""G16, Table 1: how the noise of random networks is filtered, over their size and connectivity."""

from __future__ import annotations

import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np

import trigpoint as tp
from trigpoint.arrays import FloatArray
from trigpoint.papers.base import Agreement, Cell, Reproduction, Series, cell, unspecified

SIZES = (30, 40, 50, 60, 70, 80)
SHARES = (10, 20, 30, 40, 50, 60, 70, 80, 90, 100)
PRINTED = (
    (0.754, 0.246, 0.14, 0.10, 0.078, 0.063, 0.053, 0.047, 0.041, 0.036),
    (0.446, 0.162, 0.101, 0.072, 0.056, 0.046, 0.039, 0.034, 0.029, 0.027),
    (0.310, 0.124, 0.077, 0.055, 0.044, 0.036, 0.030, 0.026, 0.023, 0.021),
    (0.238, 0.100, 0.062, 0.046, 0.036, 0.029, 0.025, 0.022, 0.019, 0.017),
    (0.193, 0.083, 0.053, 0.039, 0.030, 0.025, 0.021, 0.018, 0.016, 0.014),
    (0.163, 0.071, 0.045, 0.033, 0.026, 0.023, 0.019, 0.016, 0.014, 0.013),
)
_PAPER_SAMPLES = 1000
_COARSE = {(30, 30), (30, 40)}  # printed with two digits
_MISPRINTS = {(80, 60): "probably .022", (70, 100): "probably .015"}
_CHUNK = 125
_SURE = 3.0
_LITERAL = "E-000-5: E[e'e]/N, which is not what is printed"


@dataclass(frozen=True)
class Index:
    """Means over the networks of one cell, with standard errors.

    Attributes:
        demeaned: closed form of the paper's index: expected variance of the error over the nodes, its mean removed.
        demeaned_error: its standard error.
        sampled: the paper's own statistic, one drawn noise a network.
        spread: standard deviation of that statistic over the networks.
        literal: what the text says, ``E e'e / N``.
        samples: number of networks.
    """

    demeaned: float
    demeaned_error: float
    sampled: float
    spread: float
    literal: float
    samples: int

    @property
    def paper_error(self) -> float:
        """Standard error of the paper's 1000 networks."""
        return self.spread / float(np.sqrt(_PAPER_SAMPLES))

    def z(self, n: int, p: int) -> float:
        """How many standard errors the printed entry is off beyond its rounding."""
        off = abs(self.demeaned - PRINTED[SIZES.index(n)][SHARES.index(p)]) - _half(n, p)
        return max(off, 0.0) / float(np.hypot(self.paper_error, self.demeaned_error))


def index(n: int, share: float, samples: int, seed: np.random.SeedSequence) -> Index:
    """All of them for ``samples`` networks of ``n`` nodes and connectivity ``share`` (a fraction)."""
    rng = np.random.default_rng(seed)
    rows = [_chunk(n, share, min(_CHUNK, samples - first), rng) for first in range(0, samples, _CHUNK)]
    demeaned, sampled, literal = np.concatenate(rows, axis=1)
    error = float(demeaned.std(ddof=1) / np.sqrt(samples))
    return Index(
        float(demeaned.mean()), error, float(sampled.mean()), float(sampled.std(ddof=1)), float(literal.mean()), samples
    )


def _chunk(n: int, share: float, count: int, rng: np.random.Generator) -> FloatArray:
    """(3, count): closed form, drawn statistic, literal index of ``count`` networks at once."""
    graphs = [tp.graphs.random_connected(n, share, rng) for _ in range(count)]
    m = graphs[0].n_arcs
    head = np.stack([graph.head for graph in graphs])
    tail = np.stack([graph.tail for graph in graphs])
    net, inner = np.arange(count)[:, None], tail != tp.EXTERNAL
    other = np.where(inner, tail, head)
    L = np.zeros((count, n, n))
    place = net * n * n
    for row, column, value in (
        (head, head, 1.0),
        (other, other, inner),
        (head, other, -1.0 * inner),
        (other, head, -1.0 * inner),
    ):
        weights = np.broadcast_to(value, head.shape).ravel()
        L += np.bincount((place + row * n + column).ravel(), weights, count * n * n).reshape(L.shape)
    inverse = np.linalg.inv(L)
    trace, total = np.trace(inverse, axis1=1, axis2=2), inverse.sum(axis=(1, 2))
    noise = rng.uniform(-1.0, 1.0, (count, m))
    b = np.bincount((net * n + head).ravel(), noise.ravel(), count * n)
    b -= np.bincount((net * n + other).ravel(), (noise * inner).ravel(), count * n)
    error = np.einsum("kij,kj->ki", inverse, b.reshape(count, n))
    drawn = error.var(axis=1, ddof=1) / noise.var(axis=1, ddof=1)
    return np.stack([(trace - total / n) / (n - 1), drawn, trace / n])


def run(
    samples: int = 1000,
    seed: int = 0,
    sizes: Sequence[int] = SIZES,
    shares: Sequence[int] = SHARES,
    density: float = 1.0,
    workers: int | None = None,
) -> Reproduction:
    """Every cell of the table from its own networks; the numbers do not depend on the number of workers.

    Args:
        samples: networks a cell (the paper's 1000).
        seed: of networks and noise.
        sizes: rows N.
        shares: columns p, percent.
        density: factor on the number of arcs (the paper's is 1).
        workers: threads; all cores unless given.

    An entry agrees within its rounding and three standard errors of the paper's sample and ours together.
    """
    pairs = [(n, p) for n in sizes for p in shares]
    seeds = [np.random.SeedSequence([seed, n, p]) for n, p in pairs]
    with ThreadPoolExecutor(workers or os.cpu_count() or 1) as pool:
        jobs = [
            pool.submit(index, n, density * p / 100.0, samples, own) for (n, p), own in zip(pairs, seeds, strict=True)
        ]
        found = {pair: job.result() for pair, job in zip(pairs, jobs, strict=True)}
    cells = [*_summary(found)]
    for (n, p), one in found.items():
        cells += _cells(n, p, one)
    lines = {f"N = {n}": np.array([found[n, p].demeaned for p in shares]) for n in sizes}
    series = (Series("Table 1", "connectivity [%]", "J", np.array(shares, dtype=float), lines, log_y=True),)
    text = (
        "The printed index is the variance of the error over the nodes, its mean removed (E-000-5): removing the mean "
        "removes what the anchors contribute. The literal index is about three times larger. J is its closed form, J "
        "drawn the paper's own statistic; two entries look like misprints."
    )
    return Reproduction("g16-table1", "G16, Section 5.1, Table 1", text, tuple(cells), series)


def _half(n: int, p: int) -> float:
    """Half a unit of the last printed digit."""
    return 5e-3 if (n, p) in _COARSE else 5e-4


def _printed(found: dict[tuple[int, int], Index]) -> dict[tuple[int, int], Index]:
    return {(n, p): one for (n, p), one in found.items() if n in SIZES and p in SHARES}


def _summary(found: dict[tuple[int, int], Index]) -> list[Cell]:
    """How many entries agree, and how far the literal index is from all of them."""
    known = _printed(found)
    if not known:
        return []
    off = {pair: one.z(*pair) for pair, one in known.items()}
    outside = {pair for pair, z in off.items() if z > _SURE}
    count, within = float(len(known)), float(len(known) - len(outside))
    verdict: Agreement = "agrees" if not outside else "erratum" if outside <= set(_MISPRINTS) else "differs"
    note = "two misprints are likely" if outside else ""
    fewer = float(sum(z <= 2.0 for z in off.values()))
    ratios = [one.literal / PRINTED[SIZES.index(n)][SHARES.index(p)] for (n, p), one in known.items()]
    return [
        Cell("entries within three standard errors", count, within, within - count, verdict, note),
        unspecified("entries within two standard errors", fewer, f"of {len(known)}; some 2 are outside by chance"),
        unspecified("literal index over the printed one, least", min(ratios), _LITERAL),
        unspecified("literal index over the printed one, greatest", max(ratios), _LITERAL),
    ]


def _cells(n: int, p: int, one: Index) -> list[Cell]:
    if n not in SIZES or p not in SHARES:
        return [unspecified(f"J, N = {n}, p = {p}", one.demeaned, "not in the table")]
    printed, place = PRINTED[SIZES.index(n)][SHARES.index(p)], f"N = {n}, p = {p}"
    own = one.spread / float(np.sqrt(one.samples))
    cells = []
    for name, value, error in (("J", one.demeaned, one.demeaned_error), ("J drawn", one.sampled, own)):
        margin = _SURE * float(np.hypot(one.paper_error, error)) + _half(n, p)
        note = f"ours +- {error:.1g}, the paper's sample +- {one.paper_error:.1g}"
        note += f"; {_MISPRINTS[n, p]}" if (n, p) in _MISPRINTS else ""
        cells.append(cell(f"{name}, {place}", printed, value, margin, erratum=(n, p) in _MISPRINTS, note=note))
    literal = cell(f"E[e'e]/N, {place}", printed, one.literal, 0.0, erratum=one.literal > 2.0 * printed, note=_LITERAL)
    return [*cells, literal]
