"""Agents whose motion is given: bouncing in a square, or as a table. Pure values.

Where ``known`` is False the agents have only their own dynamics for a model: whatever else moves them disturbs them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from trigpoint.arrays import BoolArray, FloatArray, IntArray, as_floats
from trigpoint.errors import ArgumentError, ShapeError
from trigpoint.graphs import MeasurementGraph
from trigpoint.simulation.topology import Topology


@dataclass(frozen=True, eq=False)
class Trajectory:
    """States given at instants, linear in between.

    Args:
        times: (K,) ascending seconds; before the first and after the last the motion stands still.
        states: (K, N, n).
        known: the agents know their motion as their own input.
    """

    times: FloatArray
    states: FloatArray
    known: bool

    def __init__(self, times: ArrayLike, states: ArrayLike, known: bool = True) -> None:
        instants, table = np.atleast_1d(as_floats("times", times)), as_floats("states", states)
        if instants.ndim != 1 or (np.diff(instants) <= 0).any():
            raise ArgumentError("times of a trajectory must ascend")
        if table.ndim != 3 or table.shape[0] != instants.shape[0]:
            raise ShapeError(f"states must have shape (K, N, n) with K = {instants.shape[0]}; got {table.shape}")
        object.__setattr__(self, "times", instants)
        object.__setattr__(self, "states", table)
        object.__setattr__(self, "known", bool(known))

    def at(self, time: float) -> FloatArray:
        """The states (N, n) at ``time``."""
        times = self.times
        right = int(np.clip(np.searchsorted(times, time, side="right"), 1, max(times.shape[0] - 1, 1)))
        if times.shape[0] == 1:
            return np.asarray(self.states[0])
        share = float(np.clip((time - times[right - 1]) / (times[right] - times[right - 1]), 0.0, 1.0))
        return np.asarray((1.0 - share) * self.states[right - 1] + share * self.states[right])


@dataclass(frozen=True, eq=False)
class Bouncing:
    """Agents that fly straight and are reflected by the walls of a square ``[0, side] x [0, side]`` (any dimension).

    The position is the straight line folded back into the square, exactly: no step, no drift, however many bounces.

    Args:
        position: (N, d) at time 0, inside the square.
        velocity: (N, d) at time 0.
        side: length of the square's side.
        known: the agents know when they are reflected.
    """

    position: FloatArray
    velocity: FloatArray
    side: float
    known: bool

    def __init__(self, position: ArrayLike, velocity: ArrayLike, side: float, known: bool = True) -> None:
        place, speed = as_floats("position", position), as_floats("velocity", velocity)
        if place.ndim != 2 or place.shape != speed.shape:
            raise ShapeError(f"position and velocity must both be (N, d); got {place.shape} and {speed.shape}")
        if not (np.isfinite(side) and side > 0.0 and (place >= 0.0).all() and (place <= side).all()):
            raise ArgumentError(f"side must be positive and every position within 0 and {side}")
        object.__setattr__(self, "position", place)
        object.__setattr__(self, "velocity", speed)
        object.__setattr__(self, "side", float(side))
        object.__setattr__(self, "known", bool(known))

    @staticmethod
    def drawn(
        count: int,
        side: float,
        speeds: tuple[float, float],
        rng: np.random.Generator,
        dimension: int = 2,
        known: bool = True,
    ) -> Bouncing:
        """``count`` agents at uniform places, with uniform directions and speeds between the two given.

        Args: ``side`` of the square; ``rng``; ``dimension`` 2 or more; ``known`` as above.
        """
        direction = rng.standard_normal((count, dimension))
        direction /= np.linalg.norm(direction, axis=1, keepdims=True)
        speed = rng.uniform(*speeds, size=(count, 1))
        return Bouncing(rng.uniform(0.0, side, (count, dimension)), speed * direction, side, known)

    def at(self, time: float) -> FloatArray:
        """(N, 2 d): positions, then velocities, at ``time``."""
        folded = np.mod(self.position + self.velocity * time, 2.0 * self.side)
        back = folded > self.side
        position = np.where(back, 2.0 * self.side - folded, folded)
        return np.concatenate([position, np.where(back, -self.velocity, self.velocity)], axis=1)

    def positions(self, time: float) -> FloatArray:
        """(N, d) at ``time``."""
        return self.at(time)[:, : self.position.shape[1]]

    def bounces(self, until: float) -> FloatArray:
        """Instants up to ``until`` at which some agent touches a wall, ascending."""
        instants = []
        for x, v in zip(self.position.ravel().tolist(), self.velocity.ravel().tolist(), strict=True):
            if v != 0.0:
                first = (self.side - x) / v if v > 0.0 else -x / v
                instants.append(np.arange(first, until, self.side / abs(v)))
        return np.unique(np.concatenate([np.zeros(0), *instants]))


def proximity(motion: Bouncing, pairs: ArrayLike, radius: float, until: float, always: int = 0) -> Topology:
    """Arcs that work while their two ends are within ``radius``, with the exact instants of every change.

    Between two bounces the squared distance of a pair is a parabola in time; its crossings are found to rounding.

    Args:
        motion: how the agents move.
        pairs: (M, 2) the two agents of each arc.
        radius: largest distance at which an arc works.
        until: seconds to cover.
        always: number of further arcs after those that always work (anchors).
    """
    ends = np.asarray(pairs, dtype=np.int64).reshape(-1, 2)
    if not (radius > 0.0 and until > 0.0):
        raise ArgumentError(f"radius and until must be positive; got {radius} and {until}")

    def within(time: float) -> BoolArray:
        place = motion.positions(time)
        return np.asarray(((place[ends[:, 0]] - place[ends[:, 1]]) ** 2).sum(axis=1) <= radius**2)

    cuts = np.concatenate([[0.0], motion.bounces(until), [until]])
    instants = {0.0}
    for left, right in zip(cuts[:-1].tolist(), cuts[1:].tolist(), strict=True):
        if right > left:
            instants.update(_crossings(motion, ends, radius, left, right))
    times = np.array(sorted(instants))
    middles = 0.5 * (times + np.append(times[1:], until))
    rows = np.array([within(time) for time in middles.tolist()])
    kept = np.concatenate([[True], (rows[1:] != rows[:-1]).any(axis=1)])
    active = np.concatenate([rows[kept], np.ones((int(kept.sum()), always), dtype=bool)], axis=1)
    return Topology(times[kept], active)


def within_reach(motion: Bouncing, graph: MeasurementGraph, radius: float, until: float) -> Topology:
    """The ``graph`` under a ``motion``: internal arcs work within ``radius``, external ones always.

    The topology covers the time up to ``until`` [s]. Source: G16, Section 5.3; see ``proximity``.
    """
    if motion.position.shape[0] != graph.n_nodes:
        raise ShapeError(f"the motion has {motion.position.shape[0]} agents; the graph has {graph.n_nodes} nodes")
    inner = np.flatnonzero(~graph.is_external)
    near = proximity(motion, np.stack([graph.tail[inner], graph.head[inner]], axis=1), radius, until)
    active = np.ones((near.times.shape[0], graph.n_arcs), dtype=bool)
    active[:, inner] = near.active
    return Topology(near.times, active)


def _crossings(motion: Bouncing, ends: IntArray, radius: float, left: float, right: float) -> list[float]:
    """Roots of the parabolas ``|p + v s|^2 = radius^2`` within one flight without bounces."""
    d, middle = motion.position.shape[1], 0.5 * (left + right)
    state = motion.at(middle)
    p = state[ends[:, 0], :d] - state[ends[:, 1], :d]
    v = state[ends[:, 0], d:] - state[ends[:, 1], d:]
    a, b, c = (v * v).sum(axis=1), (p * v).sum(axis=1), (p * p).sum(axis=1) - radius**2
    inside = b * b - a * c
    rows = np.flatnonzero((inside > 0.0) & (a > 0.0))
    found = []
    for k in rows.tolist():
        root = float(np.sqrt(inside[k]))
        q = -(b[k] + np.copysign(root, b[k]))
        both = (middle + q / a[k], middle + (c[k] / q if q != 0.0 else np.inf))
        found += [float(time) for time in both if left < time < right]
    return found
