"""A network in two parts, one of them without an absolute reading: what the diagnosis says, and the cheapest remedy."""

import trigpoint as tp

outside = tp.EXTERNAL
graph = tp.MeasurementGraph(
    5, tail=[0, 1, 3, outside], head=[1, 2, 4, 0], names=["Alba", "Brno", "Cork", "Dijon", "Erfurt"]
)

diagnosis = tp.diagnose(graph)
print(diagnosis.summary())
assert diagnosis.observable is False
assert diagnosis.findings[0].nodes == (3, 4)

mended = tp.MeasurementGraph(5, tail=[0, 1, 3, outside, 2], head=[1, 2, 4, 0, 3], names=graph.names)
print(tp.diagnose(mended).summary())
assert tp.diagnose(mended).observable is True
print(f"lambda_min {tp.smallest_eigenvalue(mended).value:.4f}, gain bound {tp.gain_bound(mended):.4f}")
