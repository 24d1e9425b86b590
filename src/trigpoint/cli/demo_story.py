"""What the demonstration computes, from the file on."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from trigpoint.analysis import EigenvalueBound, gain_bound, smallest_eigenvalue, worst_case_gain
from trigpoint.arrays import FloatArray
from trigpoint.certificates import Certificate, certify
from trigpoint.errors import FileFormatError
from trigpoint.estimation import Estimate, estimate
from trigpoint.io import load
from trigpoint.linalg.spectral import smallest_eigenpair
from trigpoint.methods import LocalKalman
from trigpoint.model import LinearAgent, Network, NetworkedAgents
from trigpoint.observers.network import DiffusiveObserver
from trigpoint.observers.run import Run
from trigpoint.simulation import Scenario, simulate

TENTH_OF_A_MILLIMETRE = 1e-4
_PERIOD = 0.02


@dataclass(frozen=True, eq=False)
class Story:
    """Everything that the demonstration computes, for the screen, the report and JSON."""

    network: Network
    bound: EigenvalueBound
    answer: Estimate
    published: dict[str, tuple[float, float]]
    observer: DiffusiveObserver
    reduced_bound: EigenvalueBound
    certificate: Certificate
    run: Run
    slow_share: float
    distance: float
    unit_distance: float
    unit_distance_readings: float
    node_by_node: float

    @property
    def largest_difference(self) -> float:
        """Largest difference between our heights and the published ones, in metres."""
        ours = dict(zip(self.answer.names, self.answer.x.tolist(), strict=True))
        return float(max(abs(ours[name] - height) for name, (height, _) in self.published.items()))

    @property
    def largest_sigma_difference(self) -> float:
        """Largest relative difference between our standard deviations and the published ones."""
        ours = dict(zip(self.answer.names, self.answer.sigma.tolist(), strict=True))
        return float(max(abs(ours[name] / sigma - 1.0) for name, (_, sigma) in self.published.items()))

    def predicted_time(self, level: float) -> float:
        """When the slow mode alone reaches ``level`` metres: ``ln(share |e_0| / level) / (gain lambda_min)``."""
        start = self.slow_share * float(self.run.error_norm[0])
        return float(np.log(start / level)) / self.observer.decay_rate

    @property
    def holds(self) -> bool:
        """True when every promise of the demonstration is kept."""
        return self.largest_difference < 1e-8 and self.distance < 1e-9 and self.certificate.verdict == "certified"


def tell(path: Path, published: dict[str, tuple[float, float]], steps: Iterator[int]) -> Story:
    """Compute everything, from the file on; ``steps`` is advanced after each part."""
    network = load(path)
    if not isinstance(network, Network):
        raise FileFormatError(path, "holds no measured network")
    bound = smallest_eigenvalue(network.graph)
    next(steps)
    answer = estimate(network)
    next(steps)
    reduction = network.with_exact_readings_as_marks().without_known_marks()
    part = reduction.network
    problem = NetworkedAgents(part.graph.with_weight(part.precision_weights()), LinearAgent.static())
    observer = LocalKalman().build(problem)
    certificate = certify(problem, observer)
    next(steps)
    best = answer.x[reduction.nodes]
    run = _simulated(problem, observer, part, best)
    next(steps)
    _, slow = smallest_eigenpair(problem.graph.laplacian())
    start = run.error[0, :, 0]
    settled = simulate(problem, observer, Scenario([60.0 / observer.decay_rate], -best, best, measurements=part.values))
    unit = estimate(Network(part.graph, part.values), uncertainty=False).x
    readings = estimate(Network(network.graph, network.values), uncertainty=False).x[reduction.nodes]
    return Story(
        network,
        bound,
        answer,
        published,
        observer,
        smallest_eigenvalue(part.graph),
        certificate,
        run,
        abs(float(slow @ start)) / float(np.linalg.norm(start)),
        float(settled.error_norm[-1]),
        float(np.abs(unit - best).max()),
        float(np.abs(readings - best).max()),
        _node_by_node(problem, observer, part, best),
    )


def _simulated(problem: NetworkedAgents, observer: DiffusiveObserver, part: Network, best: FloatArray) -> Run:
    """Every mark starts at height 0; the readings are the file's; the error is the distance from least squares."""
    horizon = float(np.ceil(np.log(1e10) / observer.decay_rate))
    times = np.linspace(0.0, horizon, 441)
    return simulate(problem, observer, Scenario(times, -best, best, measurements=part.values))


def _node_by_node(problem: NetworkedAgents, observer: DiffusiveObserver, part: Network, best: FloatArray) -> float:
    """Largest difference between all nodes at once and one program a node with messages, over 200 exchanges."""
    times = np.linspace(0.0, 200 * _PERIOD, 21)
    runs = [
        simulate(
            problem,
            observer,
            Scenario(times, -best, best, period=_PERIOD, measurements=part.values, path=path),
        )
        for path in ("stacked", "reference")
    ]
    return float(np.abs(runs[0].estimate - runs[1].estimate).max())


def facts(story: Story) -> dict[str, Any]:
    """The JSON object of ``demo``."""
    run, norm = story.run, float(story.run.error_norm[0])
    return {
        "nodes": story.network.graph.n_nodes,
        "arcs": story.network.graph.n_arcs,
        "anchors": int(story.network.graph.is_external.sum()),
        "lambda_min": {"value": story.bound.value, "lower": story.bound.lower, "upper": story.bound.upper},
        "gain_bound": gain_bound(story.bound),
        "worst_case_gain": worst_case_gain(story.network.graph.n_nodes),
        "largest_difference_to_published": story.largest_difference,
        "largest_sigma_difference_to_published": story.largest_sigma_difference,
        "estimating_nodes": story.observer.graph.n_nodes,
        "lambda_min_estimating": story.reduced_bound.value,
        "gain": story.observer.gain,
        "decay_rate": story.observer.decay_rate,
        "decay_rate_measured": run.measured_decay_rate(),
        "certificate": {"verdict": story.certificate.verdict},
        "time_to_1_percent": run.time_to(0.01 * norm),
        "time_to_1_percent_predicted": story.predicted_time(0.01 * norm),
        "time_to_tenth_millimetre": run.time_to(TENTH_OF_A_MILLIMETRE),
        "time_to_tenth_millimetre_predicted": story.predicted_time(TENTH_OF_A_MILLIMETRE),
        "fixed_point_distance": story.distance,
        "unit_weight_distance": story.unit_distance,
        "unit_weight_distance_with_readings": story.unit_distance_readings,
        "node_by_node_difference": story.node_by_node,
    }


def observer_lines(story: Story) -> list[tuple[str, str]]:
    """What the observer does, as label and text."""
    observer, run = story.observer, story.run
    one_percent = 0.01 * float(run.error_norm[0])
    estimating, marks = observer.graph.n_nodes, story.network.graph.n_nodes - observer.graph.n_nodes
    return [
        ("who estimates", f"{estimating} marks; the {marks} known ones announce their height"),
        ("lambda_min there", f"{story.reduced_bound.value:.6f} with unit weights, "
                             f"{observer.facts['lambda_min']:.6f} with weights 1/sigma^2 (mean 1)"),
        ("gain", f"{observer.gain:.6f} = {observer.facts['gain_rule']}"),
        ("decay rate", f"{story.certificate.verdict} {observer.decay_rate:.6f} /s, "
                       f"measured {run.measured_decay_rate() or 0.0:.6f} /s"),
        ("time to 1 %", f"{run.time_to(one_percent) or 0.0:.3f} s, predicted {story.predicted_time(one_percent):.3f} s "
                        "from the smallest eigenvalue"),
        ("time to 0.1 mm", f"{run.time_to(TENTH_OF_A_MILLIMETRE) or 0.0:.3f} s, "
                           f"predicted {story.predicted_time(TENTH_OF_A_MILLIMETRE):.3f} s"),
        ("fixed point", f"{story.distance:.1e} m from the least-squares heights of part 3"),
        ("with unit weights", f"it would miss them by {1e3 * story.unit_distance:.2f} mm; by "
                              f"{1e3 * story.unit_distance_readings:.2f} mm if the known marks estimated, too"),
        ("node by node", f"one program a mark, messages every {_PERIOD} s: differs by {story.node_by_node:.1e} m"),
    ]  # fmt: skip
