"""One process a node: each gets its node file and nothing else, messages travel between neighbours only."""

import numpy as np

import trigpoint as tp
from trigpoint.runtime import run_processes

problem = tp.NetworkedAgents(tp.graphs.cycle(4, anchors=[0]), tp.LinearAgent.static())
observer = tp.design(problem, tp.methods.LocalKalman())
truth = np.array([[1.0], [4.0], [2.0], [3.0]])
readings = (problem.stacked_output() @ truth.ravel()).reshape(-1, 1)

nodes = [observer.local(node) for node in range(4)]
estimates = run_processes(nodes, np.zeros((4, 1)), lambda _: readings, period=0.1, steps=60)
scenario = tp.Scenario(0.1 * np.arange(61), -truth, truth, period=0.1, path="reference")
simulated = tp.simulate(problem, observer, scenario)

print(f"after 60 exchanges the four processes believe {estimates[-1].ravel()}")
assert np.array_equal(estimates, simulated.estimate)  # the same code, to the last bit
