"""Ten lines: can it be known, which gain, which estimator, how fast."""

import numpy as np

import trigpoint as tp

graph = tp.graphs.grid(4, 4, anchors=[0])  # 16 nodes, one of them reads its absolute value
agent = tp.LinearAgent(A=[[0, 1], [0, 0]], C=[[1, 0]])  # position and speed; neighbours compare positions
problem = tp.NetworkedAgents(graph, agent)

print(tp.diagnose(problem).summary())
observer = tp.design(problem, tp.methods.LocalKalman(gain=tp.FromGraph(margin=1.05)))
certificate = tp.certify(problem, observer)
run = tp.simulate(problem, observer, tp.Scenario(times=np.linspace(0, 20, 201), initial_error=1.0))

print(f"gain {observer.gain:.4f}, guaranteed rate {observer.decay_rate:.4f} /s, {certificate.verdict}")
print(f"error {run.error_norm[0]:.3f} -> {run.error_norm[-1]:.2e}")
print(f"1 % after {run.time_to(0.01 * run.error_norm[0]):.2f} s")
assert certificate.verdict == "certified"
assert run.measured_decay_rate() >= observer.decay_rate
