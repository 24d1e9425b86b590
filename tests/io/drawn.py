"""Networks drawn at random, with awkward names, and what it means that two networks are equal."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from hypothesis import strategies as st

from trigpoint.graphs import EXTERNAL, MeasurementGraph
from trigpoint.linalg.blocks import diagonal_of
from trigpoint.model import Network

AWKWARD = [
    "a,b",
    'say "hi"',
    "two\nlines",
    " lead",
    "trail ",
    "#hash",
    "#@ known x",
    "\ttab",
    "a\tb",
    "ü",
    "1",
    "'",
    "-",
    "x\r\ny",
]
ANY_TEXT = st.text(st.characters(exclude_categories=["Cs"], exclude_characters="\0"), min_size=1, max_size=6)
XML_TEXT = st.text(
    st.characters(min_codepoint=32, max_codepoint=0xFFFD, exclude_categories=["Cs"]), min_size=1, max_size=6
)
NUMBERS = st.floats(-1e6, 1e6, allow_nan=False)
VARIANCES = st.floats(1e-6, 1e6)


@st.composite
def networks(draw, names=ANY_TEXT, awkward=True, sizes=(0, 1, 2, 3)):
    pool = st.one_of(names, st.sampled_from(AWKWARD)) if awkward else names
    labels = draw(st.lists(pool, min_size=2, max_size=6, unique=True))
    n = len(labels)
    pairs = draw(st.lists(st.tuples(st.integers(EXTERNAL, n - 1), st.integers(0, n - 1)), min_size=1, max_size=8))
    arcs = [(t, h) for t, h in pairs if t != h] or [(0, 1)]
    size = draw(st.sampled_from(sizes))
    shape = (len(arcs), max(size, 1))
    values = np.array(draw(st.lists(NUMBERS, min_size=shape[0] * shape[1], max_size=shape[0] * shape[1]))).reshape(
        shape
    )
    readings = {}
    for k, (t, h) in enumerate(arcs):
        if t == EXTERNAL:
            readings.setdefault(h, []).append(k)
    exact = np.zeros(len(arcs), dtype=bool)
    for at_node in readings.values():
        exact[at_node[0]] = draw(st.booleans())
    candidates = [h for h, at in readings.items() if len(at) == 1 and exact[at[0]]]
    known = sorted(draw(st.sets(st.sampled_from(candidates)))) if candidates else []
    covariance = draw(covariances(len(arcs), size, exact))
    if covariance is None and any(t == EXTERNAL and not exact[k] for k, (t, _) in enumerate(arcs)):
        exact = np.array(
            [t == EXTERNAL and exact[readings[h][0]] and readings[h][0] == k for k, (t, h) in enumerate(arcs)]
        )
        covariance = np.ones(len(arcs)) if size == 0 else np.broadcast_to(np.eye(size), (len(arcs), size, size))
    place = draw(st.booleans())
    positions = np.array(draw(st.lists(NUMBERS, min_size=2 * n, max_size=2 * n))).reshape(n, 2) if place else None
    return Network(
        MeasurementGraph(n, [t for t, _ in arcs], [h for _, h in arcs], None, labels),
        values[:, 0] if size == 0 else values,
        covariance,
        exact=exact,
        known=known,
        positions=positions,
        unit=draw(st.sampled_from(["", "m", "mm per km"])),
        title=draw(st.sampled_from(["", "A title", "two\nlines", "@ odd", "x\n\ny,z"])),
        columns={"note": [draw(pool) for _ in arcs]} if draw(st.booleans()) else None,
    )


@st.composite
def covariances(draw, count, size, exact):
    if draw(st.booleans()):
        return None
    spread = np.array(draw(st.lists(VARIANCES, min_size=count * max(size, 1), max_size=count * max(size, 1))))
    if size == 0:
        return spread
    blocks = np.zeros((count, size, size))
    blocks[:, range(size), range(size)] = spread.reshape(count, size)
    if draw(st.booleans()):
        low = np.sqrt(blocks.min(axis=2, where=blocks > 0, initial=np.inf).min(axis=1))
        blocks[:, 0, -1] = blocks[:, -1, 0] = 0.5 * low**2 if size > 1 else blocks[:, 0, 0]
    return blocks


def dense(network):
    """Covariance as one (M d, M d) matrix, exact readings 0, None as unit."""
    size = network.dimension
    count = network.graph.n_arcs
    if network.covariance is None:
        whole = np.eye(count * size)
    elif sp.issparse(network.covariance):
        whole = network.covariance.toarray()
    else:
        whole = diagonal_of(np.reshape(network.covariance, (count, size, size))).toarray()
    keep = np.repeat(~network.exact, size).astype(float)
    return whole * np.outer(keep, keep)


def assert_same(left, right, rtol=1e-15, texts=True):
    assert left.graph.names == right.graph.names
    np.testing.assert_array_equal(left.graph.tail, right.graph.tail)
    np.testing.assert_array_equal(left.graph.head, right.graph.head)
    np.testing.assert_array_equal(left.values, right.values)
    np.testing.assert_array_equal(left.exact, right.exact)
    np.testing.assert_allclose(dense(left), dense(right), rtol=rtol, atol=0)
    assert sorted(left.known) == sorted(right.known)
    assert left.unit == right.unit
    if left.positions is None or right.positions is None:
        assert left.positions is right.positions
    else:
        np.testing.assert_array_equal(left.positions, right.positions)
    if texts:
        assert left.title == right.title
        assert left.columns == right.columns
    if left.graph.weight is None:
        assert right.graph.weight is None
    else:
        np.testing.assert_array_equal(left.graph.weight, right.graph.weight)
