"""A measured network: least squares with standard deviations, then the marks find the same answer by themselves."""

from pathlib import Path

import numpy as np

import trigpoint as tp

network = tp.load(Path(__file__).with_name("levelling.csv"))
best = tp.estimate(network)
for name, height, sigma in zip(best.names, best.x, best.sigma, strict=True):
    print(f"{name}: {height:.4f} m +- {1e3 * sigma:.2f} mm")

part = network.with_exact_readings_as_marks().without_known_marks()  # A is known: it announces, the others estimate
problem = tp.NetworkedAgents(part.network.graph.with_weight(part.network.precision_weights()), tp.LinearAgent.static())
observer = tp.design(problem, tp.methods.LocalKalman())
start = -best.x[part.nodes]  # everybody begins at height 0
scenario = tp.Scenario([0.0, 10.0, 40.0], start, best.x[part.nodes], measurements=part.network.values)
run = tp.simulate(problem, observer, scenario)

print("distance from the least-squares heights [m]:", np.array2string(run.error_norm, precision=2))
assert run.error_norm[-1] < 1e-9
