"""Rigorous facts about an observer given by programs: its error obeys ``e' = H e``, and how accurately H is known."""

from __future__ import annotations

import math

import numpy as np

from trigpoint.arrays import BoolArray, FloatArray
from trigpoint.linalg.balls import Ball
from trigpoint.linalg.blocks import Ranges
from trigpoint.linalg.fine import Fine, product
from trigpoint.linalg.verified import gam
from trigpoint.model import SharedPlant
from trigpoint.observers.assembled import AssembledObserver

DENSE_LIMIT = 600
_LOST = 2.0**-1074


def error_is_autonomous(observer: AssembledObserver) -> bool:
    """Prove ``e' = H e`` exactly, arc by arc: no part of the truth, and no known input, drives the error.

    Every program has the problem's own dynamics, ``A_i V_i = V_i A`` on what it estimates, and its inputs,
    ``B_i = V_i B``; every innovation vanishes in agreement: ``sign C_k = output V_i - sum rows V_j``; a readout returns
    what the node estimates. The targets V have entries 0 and 1 only, so that each equation is a sum of stored numbers,
    which is compared with zero without any rounding. False means *not proved*.
    """
    if observer.is_discrete and observer.period is not None:
        return False
    channels = observer.channels
    V = [
        np.asarray(observer.target(k) @ target.toarray())
        for k, target in enumerate(channels.targets)
    ]  # fmt: skip
    if not all(np.isin(matrix, (0.0, 1.0)).all() and (matrix.sum(axis=1) <= 1.0).all() for matrix in V):
        return False
    A, C = channels.A.toarray(), channels.C.toarray()
    position = {name: k for k, name in enumerate(observer.names)}
    for k, node in enumerate(observer.nodes):
        if not (_vanishes([(node.A, V[k])], V[k] @ A) and _reads_out(observer, k) and _is_driven_alike(observer, k)):
            return False
        for arc in node.arcs:
            terms = [(arc.output, V[k]), *((-rows, V[position[name]]) for name, rows in arc.heard)]
            read = np.zeros((arc.output.shape[0], A.shape[0]))
            if arc.label is not None:
                read = arc.sign * C[channels.readings.slice(arc.label)]
            if abs(arc.sign) != 1.0 or not _vanishes(terms, read):
                return False
    return True


def _vanishes(terms: list[tuple[FloatArray, FloatArray]], other: FloatArray) -> bool:
    """Is ``sum of M V - other`` zero, exactly? V has entries 0 and 1: every entry is a sum of entries of the M."""
    numbers = np.hstack([matrix for matrix, _ in terms])
    chosen = np.vstack([V for _, V in terms]) != 0.0
    if numbers.shape[0] != other.shape[0]:
        return False
    for column in range(other.shape[1]):
        parts = np.column_stack([numbers[:, chosen[:, column]], -other[:, column]])
        if not all(_sums_to_zero(row) for row in parts.tolist()):
            return False
    return True


def _sums_to_zero(row: list[float]) -> bool:
    try:
        return math.fsum(row) == 0.0  # correctly rounded: zero only where the sum is, a multiple of 2^-1074
    except OverflowError:
        return False


def _reads_out(observer: AssembledObserver, k: int) -> bool:
    """A readout M with ``M V_i = I``, and nothing that enters the estimate beside it."""
    node = observer.nodes[k]
    if node.feedthrough:
        return False
    if node.readout is None:
        return True
    target = observer.target(k)
    return _vanishes([(node.readout, target)], np.eye(target.shape[1]))


def _is_driven_alike(observer: AssembledObserver, k: int) -> bool:
    """``B_i = V_i B``, entry by entry; a row of V holds at most one 1, so that the product is exact."""
    node, problem = observer.nodes[k], observer.problem
    B = problem.B if isinstance(problem, SharedPlant) else problem.agents[k].B
    target = observer.target(k)
    known = np.zeros((target.shape[1], 0)) if B is None else B
    own = np.zeros((node.n_states, 0)) if node.B is None else node.B
    return np.array_equal(own, target @ known)


def error_magnitude(observer: AssembledObserver) -> Ball:
    """H as computed, with a bound of its rounding error entry by entry; exact zeros have radius 0."""
    total = observer.states.total
    size, terms, lost = np.zeros((total, total)), np.ones(total), np.zeros((total, total))
    ranges: Ranges = observer.states
    position = {name: k for k, name in enumerate(observer.names)}
    for k, node in enumerate(observer.nodes):
        own = ranges.slice(k)
        size[own, own] += np.abs(node.A)
        for arc in node.arcs:
            for place, rows in ((own, arc.output), *((ranges.slice(position[n]), r) for n, r in arc.heard)):
                size[own, place] += np.abs(arc.gain) @ np.abs(rows)
                lost[own, place] += (arc.gain != 0.0).astype(float) @ (rows != 0.0)  # products that may underflow
            terms[own] += arc.gain.shape[1] + 2
    radius = np.asarray(gam(4.0 * terms + 32.0))[:, None] * size + lost * _LOST
    return Ball(observer.error_matrix().toarray(), radius)


def error_to_more_digits(observer: AssembledObserver) -> Fine:
    """The same H, to about twice the digits; summed arc by arc from the programs."""
    ranges: Ranges = observer.states
    total = Fine.zero(ranges.total, ranges.total)
    position = {name: k for k, name in enumerate(observer.names)}
    for k, node in enumerate(observer.nodes):
        own = ranges.slice(k)
        _add(total, (own, own), Fine.of(Ball.exact(node.A)), node.A != 0.0)
        for arc in node.arcs:
            _add(total, (own, own), -product(arc.gain, arc.output), _reach(arc.gain, arc.output))
            for name, rows in arc.heard:
                place = (own, ranges.slice(position[name]))
                _add(total, place, product(arc.gain, rows), _reach(arc.gain, rows))
    return total


def _reach(gain: FloatArray, rows: FloatArray) -> BoolArray:
    return np.asarray((gain != 0.0).astype(float) @ (rows != 0.0) > 0.0)


def _add(total: Fine, place: tuple[slice, slice], part: Fine, reach: BoolArray) -> None:
    """Add in place; where no product reaches, the sum keeps its radius."""
    added = total.block(*place) + Fine(part.middle, part.low, np.where(reach, part.radius, 0.0))
    parts = ((total.middle, added.middle), (total.low, added.low), (total.radius, added.radius))
    for whole, piece in parts:
        whole[place] = piece


def reading_gain(observer: AssembledObserver) -> Ball:
    """K of ``e' = H e + K v``: what the noise v of the readings does; gains of one reading in one node add up."""
    readings, ranges = observer.channels.readings, observer.states
    size, count = np.zeros((ranges.total, readings.total)), np.zeros((ranges.total, readings.total))
    for k, node in enumerate(observer.nodes):
        for arc in node.arcs:
            if arc.label is not None:
                place = (ranges.slice(k), readings.slice(arc.label))
                size[place] += np.abs(arc.sign * arc.gain)
                count[place] += 1.0
    radius = np.where(count > 1.0, gam(2.0 * count) * size, 0.0)
    return Ball(observer.general_form().K.toarray(), radius)
