"""What `check` computes on large networks, part by part: seconds of one thread and peak memory, a process each.

"eigenvalue" is the core's engine, "fast" that of the extra `fast`; the sum of components, critical and one of them is
what `check` takes. Networks: square grids, random planar ones (Delaunay), geometric ones (1 % anchored), scale-free
ones (preferential attachment). Beside ours stands SciPy's shift-invert Lanczos with its defaults, without any bounds.
Run: python benchmarks/check.py [--large] [kind ...]     (10^4 and 10^5 nodes; --large adds 10^6)
"""

import json
import os
import resource
import subprocess
import sys
import time

LIMIT = 900
PARTS = ["build", "components", "critical", "eigenvalue", "fast", "eigsh"]
KINDS = ["grid", "planar", "geometric", "scale-free"]
SMALL_ONLY = {("scale-free", part) for part in ("eigenvalue", "eigsh")}  # the factor fills up
ENGINES = {"eigenvalue": "superlu", "fast": "approx-chol"}  # the core's engine and that of the extra "fast"
SCALE_FREE_LIMIT = 10_000


def network(kind, count):
    import numpy as np
    from scipy.spatial import Delaunay

    import trigpoint as tp

    rng = np.random.default_rng(0)
    if kind == "grid":
        side = round(count**0.5)
        return tp.graphs.grid(side, side)
    if kind == "planar":
        triangles = Delaunay(rng.random((count, 2))).simplices
        pairs = np.sort(np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [0, 2]]]), axis=1)
        pairs = np.unique(pairs, axis=0)
        return tp.MeasurementGraph(count, np.append(pairs[:, 0], -1), np.append(pairs[:, 1], 0))
    if kind == "geometric":
        anchors = rng.choice(count, count // 100, replace=False)
        graph = tp.graphs.within_radius(rng.random((count, 2)), (8.0 / (np.pi * count)) ** 0.5, anchors)
        return graph.subgraph(np.flatnonzero(graph.component_is_anchored[graph.component_labels]))
    ends = [0, 1]  # each end of each arc once: drawing from it is drawing by degree
    tail, head = [0], [1]
    for node in range(2, count):
        for _ in range(2):
            other = ends[int(rng.integers(len(ends)))]
            tail.append(other), head.append(node)
        ends += [tail[-1], tail[-2], node, node]
    return tp.MeasurementGraph(count, [*tail, -1], [*head, 0])


def run(part, kind, count):
    """One part on one network, in this process: its CPU seconds and the process's peak memory in MB."""
    import numpy as np
    from scipy.sparse.linalg import eigsh

    import trigpoint as tp
    from trigpoint.analysis.critical import critical
    from trigpoint.errors import MissingExtraError

    start = time.process_time()
    graph = network(kind, count)
    note = f"{graph.n_nodes} nodes, {graph.n_arcs} arcs"
    if part not in ("build", "components"):
        graph.components  # noqa: B018 - computed once, kept by the graph
    if part != "build":
        start = time.process_time()
    if part == "components":
        note = f"{len(graph.components)} components"
    elif part == "critical":
        found = critical(graph)
        note = f"{found.arcs.size} arcs and {found.anchors.size} anchors critical"
    elif part in ENGINES:
        try:
            bound = tp.smallest_eigenvalue(graph, engine=ENGINES[part])
        except MissingExtraError:
            print(json.dumps(None))
            return
        note = f"{bound.value:.10e}, relative width {bound.relative_width:.1e}"
    elif part == "eigsh":
        value = eigsh(graph.laplacian().tocsc(), k=1, sigma=0.0, which="LM", v0=np.ones(graph.n_nodes))[0][0]
        note = f"{value:.10e}"
    seconds = time.process_time() - start
    print(json.dumps([seconds, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024, note]))


def measured(part, kind, count):
    environment = {**os.environ, "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
    command = [sys.executable, __file__, "--part", part, kind, str(count)]
    try:
        done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=LIMIT, check=False)
    except subprocess.TimeoutExpired:
        return f"beyond {LIMIT} s"
    if done.returncode != 0:
        return "failed"
    row = json.loads(done.stdout)
    return f"extra {part} not installed" if row is None else row


def main(kinds, sizes):
    print("network       nodes  part          seconds  peak MB  ratio to eigsh  result")
    for kind in kinds:
        for count in sizes:
            parts = [part for part in PARTS if count <= SCALE_FREE_LIMIT or (kind, part) not in SMALL_ONLY]
            rows = {part: measured(part, kind, count) for part in parts}
            reference = rows.get("eigsh") if isinstance(rows.get("eigsh"), list) else None
            for part, row in rows.items():
                if isinstance(row, str):
                    print(f"{kind:10s} {count:8d}  {part:12s}  {row}")
                    continue
                ratio = f"{row[0] / reference[0]:14.2f}" if reference else " " * 14
                print(f"{kind:10s} {count:8d}  {part:12s} {row[0]:8.3f} {row[1]:8.0f}  {ratio}  {row[2]}", flush=True)


if __name__ == "__main__":
    words = sys.argv[1:]
    if words[:1] == ["--part"]:
        run(words[1], words[2], int(words[3]))
    else:
        chosen = [word for word in words if word != "--large"] or KINDS
        main(chosen, [10_000, 100_000, *([1_000_000] if "--large" in words else [])])
