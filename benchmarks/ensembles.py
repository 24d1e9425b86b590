"""Ensembles: the NumPy engine beside the JAX engine, on whatever JAX finds, with the same draws.

Lost arcs and noise on grids of oscillators with one anchor in a corner, 100 exchanges of 10 us. Wall seconds with all
cores, the second of two calls (the first compiles), and the largest difference of the two covariances.
Run: python benchmarks/ensembles.py [runs]        (512 runs unless given)
"""

import sys
import time

import jax
import numpy as np

import trigpoint as tp

SIDES = (3, 10, 20, 36)


def seconds(work):
    work()
    start = time.perf_counter()
    return work(), time.perf_counter() - start


def main(runs):
    print(f"{runs} runs; JAX {jax.__version__} on {jax.devices()[0].device_kind}")
    print(f"{'nodes':>6} {'NumPy s':>8} {'JAX s':>8} {'NumPy/JAX':>10} {'difference':>11}")
    agent = tp.LinearAgent([[0.0, 1.0], [-1.0, 0.0]], [[1.0, 0.0]])
    for side in SIDES:
        problem = tp.NetworkedAgents(tp.graphs.grid(side, side, anchors=(0,)), agent)
        observer = tp.design(
            problem, tp.methods.Sampled(1e-5, "innovation-held", tp.methods.LocalKalman(tp.Fixed(1.0)))
        )
        scenario = tp.Scenario([0.0, 1e-3], 1.0, period=1e-5, noise=tp.simulation.Noise(0.3, 0.5), seed=9)

        def ran(engine, problem=problem, observer=observer, scenario=scenario):
            return tp.simulation.ensemble(problem, observer, scenario, runs, arrival=0.7, engine=engine)

        (first, plain), (second, compiled) = (seconds(lambda engine=engine: ran(engine)) for engine in ("numpy", "jax"))
        gap = np.abs(first.covariance - second.covariance).max() / np.abs(first.covariance).max()
        print(f"{side * side:>6} {plain:>8.3f} {compiled:>8.3f} {plain / compiled:>10.2f} {gap:>11.1e}")


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 512)
