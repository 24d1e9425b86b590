"""G16, Section 5.3: eight agents bounce in a square and know where they are through one, two or three anchors."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np

import trigpoint as tp
from trigpoint.arrays import FloatArray
from trigpoint.papers import g16_riccati
from trigpoint.papers.base import Cell, Reproduction, Series, cell, expected, holds, unspecified
from trigpoint.simulation import Bouncing, Topology, proximity

_FREE = "square, speeds, anchors' reach are ours"
_STUDY = (1.0, 1.5, 2.0, 2.5, 3.0)
_DRAWS = 3


@dataclass(frozen=True)
class World:
    """What the paper leaves open.

    Attributes:
        agents: how many.
        radius: reach of a measurement between two agents, m.
        side: of the square, m.
        speed: least and greatest speed, m/s.
        persistent: the anchored agents hear their anchor always; else within ``radius`` of the square's centre.
        horizon: s.
        seed: of places, directions and speeds.
    """

    agents: int
    radius: float
    side: float
    speed: tuple[float, float]
    persistent: bool
    horizon: float
    seed: int

    @property
    def motion(self) -> Bouncing:
        """The flight, whose reflections nobody announces."""
        return Bouncing.drawn(self.agents, self.side, self.speed, np.random.default_rng(self.seed), known=False)

    @property
    def pairs(self) -> list[tuple[int, int]]:
        """All pairs of agents."""
        return list(itertools.combinations(range(self.agents), 2))

    def graph(self, anchors: int) -> tp.MeasurementGraph:
        """Every arc that ever works: all pairs, and an anchor for each of the first ``anchors`` agents."""
        tail = [a for a, _ in self.pairs] + [tp.EXTERNAL] * anchors
        return tp.MeasurementGraph(self.agents, tail, [b for _, b in self.pairs] + list(range(anchors)))

    def topology(self, anchors: int) -> Topology:
        """Which of them work when."""
        motion = self.motion
        if self.persistent:
            return proximity(motion, self.pairs, self.radius, self.horizon, always=anchors)
        # An anchor is one more agent that stands still at the centre.
        still = np.full((1, 2), 0.5 * self.side)
        place = np.vstack([motion.position, still])
        both = Bouncing(place, np.vstack([motion.velocity, np.zeros((1, 2))]), self.side, known=False)
        ends = [*self.pairs, *((agent, self.agents) for agent in range(anchors))]
        return proximity(both, ends, self.radius, self.horizon)


@dataclass(frozen=True, eq=False)
class Case:
    """One run: error norm and 1/lambda_min at the times (infinite where an agent is cut off)."""

    run: tp.Run
    bound: FloatArray

    @property
    def connected(self) -> FloatArray:
        """(T,) whether every agent has a path to an anchor."""
        return np.isfinite(self.bound)

    @property
    def worst(self) -> float:
        """Largest 1/lambda_min while connected."""
        return float(self.bound[self.connected].max(initial=0.0))

    @property
    def typical(self) -> tuple[float, float]:
        """Median norm of the whole error and of its positions over the later half."""
        later = self.run.error[self.run.times.shape[0] // 2 :]
        whole, places = (np.sqrt((part**2).sum(axis=(1, 2))) for part in (later, later[:, :, :2]))
        return float(np.median(whole)), float(np.median(places))


def case(world: World, anchors: int, gain: float, times: FloatArray) -> Case:
    """Simulate the estimators of the paper, with the Q_1 that it prints."""
    problem = tp.NetworkedAgents(world.graph(anchors), g16_riccati.agent())
    process = np.diag([0.0, 0.0, 1.0, 1.0])
    observer = tp.design(problem, tp.methods.LocalKalman(gain=tp.Fixed(gain), process=process))
    motion = world.motion
    scenario = tp.Scenario(times, -motion.at(0.0), topology=world.topology(anchors), motion=motion)
    run = tp.simulate(problem, observer, scenario)
    return Case(run, bounds(run["lambda_min"]))


def bounds(eigenvalues: FloatArray) -> FloatArray:
    """``1 / lambda_min``, infinite where lambda_min is zero to rounding."""
    apart = eigenvalues < 1e-9
    return np.asarray(np.where(apart, np.inf, 1.0 / np.where(apart, 1.0, eigenvalues)))


def run(
    gain: float = 15.0,
    gain_fig5: float = 10.0,
    seed: int = 0,
    side: float = 2.0,
    speed: tuple[float, float] = (0.5, 1.0),
    persistent: bool = True,
    agents: int = 8,
) -> Reproduction:
    """Figs. 5 and 6: error norm and 1/lambda_min(t) for 1, 2, 3 anchors.

    Args:
        gain: of Fig. 6.
        gain_fig5: of Fig. 5 (two anchors).
        seed: of places, directions and speeds.
        side: of the square, m; about 2 fits what the paper says of Fig. 6.
        speed: least and greatest, m/s.
        persistent: the first agents hear their anchors always.
        agents: how many.

    We assume: rho_max = 1.2, estimates start from zero, reflections come as surprises, 12 s.
    """
    world = World(agents, 1.2, side, speed, persistent, 12.0, seed)
    times = np.linspace(0.0, world.horizon, 601)
    cases = {anchors: case(world, anchors, gain, times) for anchors in (1, 2, 3)}
    fifth = case(world, 2, gain_fig5, times)
    cells = _claims(cases, gain, agents)
    for anchors, one in cases.items():
        cells += _open(f"{anchors} anchor{'s' if anchors > 1 else ''}, gain {gain:g}", one)
    cells += _open(f"2 anchors, gain {gain_fig5:g}", fifth)
    cells += _of_side(world)
    cells += _estimator()
    text = (
        "The paper leaves square, speeds and anchors open. In a square of side 1 the bound 15 is never exceeded, from "
        "side 3 on the network is mostly cut apart; side 2 matches what is said of Fig. 6. The printed Q_1 belongs to "
        "M = diag(0, 0, 1, 1) (E-000-4). Gaps in the lower figure: some agent has no path to an anchor."
    )
    return Reproduction(
        "g16-moving", "G16, Section 5.3, Figs. 5 and 6", text, tuple(cells), _series(times, cases, fifth, gain_fig5)
    )


def _claims(cases: dict[int, Case], gain: float, agents: int) -> list[Cell]:
    means, Q = [float(one.run["lambda_min"].mean()) for one in cases.values()], _filter()
    last = max(float(one.run.error_norm[-300:].min()) for one in cases.values())
    return [
        cell("gain that no topology can spoil, sigma_max(Phi_8)", 29.37, tp.worst_case_gain(agents), 5e-3),
        cell("diagonal of Q_1", 1.41, Q[0, 0], 5e-3),
        cell("off the diagonal of Q_1", 1.0, Q[0, 2], 5e-3),
        holds("more anchors, greater lambda_min (means over time)", means[0] < means[1] < means[2]),
        holds("1/lambda_min(t) exceeds the gain at some time", not (cases[1].bound < gain).all(), "one anchor"),
        holds("the error stays above zero (reflections)", last > 0.0),
    ]


def _filter() -> FloatArray:
    return g16_riccati.local_filter(np.diag([0.0, 0.0, 1.0, 1.0]))


def _open(label: str, one: Case) -> list[Cell]:
    return [
        unspecified(f"{label}: median error norm of the later half", one.typical[0], _FREE),
        unspecified(f"{label}: median of the positions' error norm", one.typical[1], _FREE),
        unspecified(f"{label}: largest 1/lambda_min while connected", one.worst, _FREE),
        unspecified(f"{label}: share of the time connected", float(one.connected.mean()), _FREE),
    ]


def _of_side(world: World) -> list[Cell]:
    """How the square's side decides whether 15 is exceeded: one anchor, several draws, the topology alone."""
    cells = []
    for side in _STUDY:
        found = []
        for draw in range(_DRAWS):
            one = World(world.agents, world.radius, side, world.speed, world.persistent, world.horizon, draw)
            topology, graph = one.topology(1), one.graph(1)
            L = [topology.graph_at(graph, time).laplacian().toarray() for time in np.arange(0.0, one.horizon, 0.05)]
            found.append(bounds(np.linalg.eigvalsh(np.array(L))[:, 0]))
        values = np.concatenate(found)
        known = np.isfinite(values)
        at = f"side {side:g}, 1 anchor, {_DRAWS} draws"
        cells.append(unspecified(f"{at}: largest 1/lambda_min while connected", values[known].max(initial=0.0), _FREE))
        cells.append(unspecified(f"{at}: share of the time connected", known.mean(), _FREE))
    return cells


def _estimator() -> list[Cell]:
    """The two slips of the printed estimator, from the assembled one."""
    problem = tp.NetworkedAgents(tp.graphs.chain(3), g16_riccati.agent())
    observer = tp.design(problem, tp.methods.LocalKalman(gain=tp.Fixed(1.0), process=np.diag([0.0, 0.0, 1.0, 1.0])))
    own = observer.error_matrix().toarray()[4:8, 4:8] - g16_riccati.agent().A
    times = float(own[0, 0] / -_filter()[0, 0])
    position, mark = 0.3, 0.7
    anchor = ((mark - position) - mark) / position
    note = "E-000-8: once for each arc"
    return [
        cell("L_1 r_i in the program of an agent with two arcs, times", 1.0, times, 1e-9, erratum=True, note=note),
        cell("what an anchor arc tells, over r_i", 1.0, anchor, 1e-9, erratum=True, note="E-000-8: minus the position"),
        expected("arcs of that agent", 2.0, times, 1e-9, "|O_i|"),
    ]


def _series(times: FloatArray, cases: dict[int, Case], fifth: Case, gain_fig5: float) -> tuple[Series, ...]:
    names = {anchors: f"{anchors} anchor{'s' if anchors > 1 else ''}" for anchors in cases}
    norms = {names[anchors]: one.run.error_norm for anchors, one in cases.items()}
    inverse = {names[anchors]: np.where(one.connected, one.bound, np.nan) for anchors, one in cases.items()}
    places = {f"agent {k + 1}": fifth.run.truth[:, k, 0] for k in range(min(8, fifth.run.truth.shape[1]))}
    gaps = "Gaps: some agent has no path to an anchor, so that lambda_min is 0."
    return (
        Series("Fig. 5, left: coordinate x", "time [s]", "x [m]", times, places),
        Series(
            f"Fig. 5, right: error norm, 2 anchors, gain {gain_fig5:g}",
            "time [s]",
            "error norm",
            times,
            {"error": fifth.run.error_norm},
            log_y=True,
        ),
        Series("Fig. 6, top: error norm", "time [s]", "error norm", times, norms, log_y=True),
        Series("Fig. 6, bottom: 1/lambda_min(t)", "time [s]", "1/lambda_min", times, inverse, caption=gaps),
    )
