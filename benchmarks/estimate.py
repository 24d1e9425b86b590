"""Least squares with and without standard deviations on levelled grids (CPU seconds, one thread).

Run: OPENBLAS_NUM_THREADS=1 python benchmarks/estimate.py [rows ...]
"""

import sys
import time

import numpy as np

import trigpoint as tp


def seconds(work):
    start = time.process_time()
    work()
    return time.process_time() - start


def main(sizes):
    rng = np.random.default_rng(0)
    print("    nodes  values only [s]  with sigma [s]  ratio")
    for rows in sizes:
        graph = tp.graphs.grid(rows, rows)
        network = tp.Network(graph, rng.normal(size=graph.n_arcs), np.ones(graph.n_arcs))
        plain = seconds(lambda network=network: tp.estimate(network, uncertainty=False))
        whole = seconds(lambda network=network: tp.estimate(network))
        print(f"{graph.n_nodes:9d} {plain:16.3f} {whole:15.3f} {whole / plain:6.1f}")


if __name__ == "__main__":
    main([int(text) for text in sys.argv[1:]] or [10, 30, 100])
