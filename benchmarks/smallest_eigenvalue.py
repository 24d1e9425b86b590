"""Smallest eigenvalue with rigorous bounds, against SciPy's shift-invert Lanczos without any (CPU seconds, one thread).

Run: OPENBLAS_NUM_THREADS=1 python benchmarks/smallest_eigenvalue.py [rows ...]
"""

import sys
import time

from scipy.sparse.linalg import eigsh

import trigpoint as tp


def seconds(work):
    start = time.process_time()
    result = work()
    return time.process_time() - start, result


def main(sizes):
    print("grid rows   nodes     ours [s]  eigsh [s]  ratio  relative width of the bounds")
    for rows in sizes:
        graph = tp.graphs.grid(rows, rows)
        ours, bound = seconds(lambda graph=graph: tp.smallest_eigenvalue(graph))
        matrix = graph.laplacian().tocsc()
        theirs, _ = seconds(lambda matrix=matrix: eigsh(matrix, k=1, sigma=0.0, which="LM"))
        print(
            f"{rows:9d} {graph.n_nodes:8d} {ours:11.3f} {theirs:10.3f} {ours / theirs:6.2f}  {bound.relative_width:.1e}"
        )


if __name__ == "__main__":
    main([int(text) for text in sys.argv[1:]] or [30, 100, 300])
