"""How fast `simulate` is: CPU seconds of one thread, a process each, with ratios to SciPy's best stock integrator.

"image": G16's and R23's grid of 70 x 128 constants, weights 1000, one corner anchor, six output times to 156.27 s;
"grid", "geometric": 10^6 double integrators, ten output times; "reference": node by node with messages in between, 400
nodes, over channels of several kinds (short runs are mostly preparation).
Run: python benchmarks/simulate.py [--large] [part ...]       (--large: 10^6 nodes; without it 10^5)
"""

import json
import os
import resource
import subprocess
import sys
import time

LIMIT = 1800
PARTS = ["image", "reference", "grid", "geometric"]
FRAMES = [1e-3, 0.01, 0.1, 1.0, 10.0, 156.27]


def seconds(work, repeat=1):
    """CPU seconds of the fastest of several calls, and what it returned."""
    best = float("inf")
    for _ in range(repeat):
        start = time.process_time()
        result = work()
        best = min(best, time.process_time() - start)
    return best, result


def image(_):
    import numpy as np
    import scipy.sparse as sp
    from scipy.integrate import solve_ivp

    import trigpoint as tp
    from trigpoint.analysis.modes import largest_eigenvalue_bound
    from trigpoint.linalg import chebyshev

    graph = tp.graphs.grid(70, 128, anchors=(8959,))
    graph = graph.with_weight(np.full(graph.n_arcs, 1000.0))
    problem = tp.NetworkedAgents(graph, tp.LinearAgent.static())
    observer = tp.design(problem, tp.methods.LocalKalman(tp.Fixed(1.0)))
    start = -np.random.default_rng(0).uniform(0.0, 255.0, 8960)
    size = np.linalg.norm(start)
    matrix, ceiling = graph.laplacian(), largest_eigenvalue_bound(graph)
    several = [chebyshev.series(lambda x, t=t: np.exp(-x * t)[:, None, None], ceiling, 1e-12, 20_000) for t in FRAMES]
    exact = [row[:, 0] for row in chebyshev.applied(matrix, ceiling, start[:, None], several)]

    def gap(rows):
        return max(np.linalg.norm(row - other) for row, other in zip(rows, exact, strict=True)) / size

    def ours(tolerance):
        return tp.simulate(problem, observer, tp.Scenario(FRAMES, start, -start, tolerance=tolerance))

    H = -sp.csc_matrix(matrix)

    def stock():
        options = {"method": "BDF", "jac": H, "rtol": 1e-7, "atol": 1e-7 * size / 95.0, "t_eval": FRAMES}
        return solve_ivp(lambda _, e: H @ e, (0.0, FRAMES[-1]), start, **options).y.T

    rows = [
        (f"tolerance {goal:g} ({run.attributes['engines']})", spent, gap(run.error[:, :, 0]))
        for goal in (1e-6, 1e-8)
        for spent, run in [seconds(lambda goal=goal: ours(goal), 5)]
    ]
    spent, solution = seconds(stock, 3)
    rows.append(("solve_ivp BDF, sparse Jacobian", spent, gap(solution)))
    first = rows[0][1]
    return [f"{name}: {spent:.3f} s, error {error:.1e}, ratio {spent / first:.1f}" for name, spent, error in rows]


def reference(_):
    import numpy as np

    import trigpoint as tp
    from trigpoint.simulation import Channel, Clocks

    problem = tp.NetworkedAgents(tp.graphs.grid(20, 20), tp.LinearAgent([[0, 1], [-1, 0]], [[1, 0]]))
    observer = tp.design(problem, tp.methods.LocalKalman())
    late = {"channel": Channel(jitter=0.02, old="propagate")}
    kinds = {
        "ideal links": {"path": "reference"},
        "loss .2": {"channel": Channel(loss=0.2)},
        "loss .2, propagated": {"channel": Channel(loss=0.2, old="propagate")},
        "up to two periods late, propagated": late,
        "clocks that differ": {"clocks": Clocks(phase=np.linspace(0.0, 0.009, 400))},
    }

    def rate(options, steps):
        scenario = tp.Scenario([0.0, 0.01 * steps], 1.0, period=0.01, **options)
        return 400 * steps / seconds(lambda: tp.simulate(problem, observer, scenario), 3)[0]

    rows = []
    for steps in (10, 300):
        rates = {name: rate(options, steps) for name, options in kinds.items()}
        ideal = rates["ideal links"]
        rows += [
            f"{steps} exchanges, {n}: {r:.3g} node-steps/s, ideal / this {ideal / r:.1f}" for n, r in rates.items()
        ]
    return rows


def million(kind, count):
    import numpy as np

    import trigpoint as tp

    rng = np.random.default_rng(0)
    if kind == "grid":
        side = round(count**0.5)
        graph = tp.graphs.grid(side, side, anchors=(0,))
    else:
        anchors = rng.choice(count, count // 100, replace=False)
        graph = tp.graphs.within_radius(rng.random((count, 2)), (8.0 / (np.pi * count)) ** 0.5, anchors)
        graph = graph.subgraph(np.flatnonzero(graph.component_is_anchored[graph.component_labels]))
    built = time.process_time()
    agent = tp.LinearAgent([[0.0, 1.0], [0.0, 0.0]], [[1.0, 0.0]])
    problem = tp.NetworkedAgents(graph, agent)
    observer = tp.design(problem, tp.methods.LocalKalman(tp.Fixed(10.0)))
    designed = time.process_time()
    error = rng.normal(size=(graph.n_nodes, 2))
    scenario = tp.Scenario(np.geomspace(0.1, 1000.0, 10), error, tolerance=1e-6)
    run = tp.simulate(problem, observer, scenario)
    spent = time.process_time() - designed
    facts = run.attributes
    return [
        f"{graph.n_nodes} nodes, {graph.n_arcs} arcs: design {designed - built:.1f} s, simulate {spent:.1f} s "
        f"({facts['engines']}), error estimate {facts['error_estimate']:.1e}, "
        f"error norm {np.linalg.norm(error):.4g} -> {run.error_norm[-1]:.4g}"
    ]


def run_part(part, count):
    rows = {"image": image, "reference": reference}.get(part, lambda count: million(part, count))(count)
    print(json.dumps([rows, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024]))


def main(parts, count):
    environment = {**os.environ, "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
    for part in parts:
        command = [sys.executable, __file__, "--part", part, str(count)]
        done = subprocess.run(command, env=environment, stdout=subprocess.PIPE, text=True, timeout=LIMIT, check=True)
        rows, peak = json.loads(done.stdout)
        for row in rows:
            print(f"{part:10s} {row}")
        print(f"{part:10s} peak memory {peak:.0f} MB", flush=True)


if __name__ == "__main__":
    words = sys.argv[1:]
    if words[:1] == ["--part"]:
        run_part(words[1], int(words[2]))
    else:
        main([word for word in words if word != "--large"] or PARTS, 1_000_000 if "--large" in words else 100_000)
