"""Certificates of large networks: time and memory to certify and to verify (CPU seconds, one thread).

Run: OPENBLAS_NUM_THREADS=1 python benchmarks/certify.py [--rows 1000] [--arcs 10000000] [--cascade]

Prints the certified bounds of a chain of 2000 nodes beside the closed form; of a grid of --rows x --rows nodes with one
anchor in a corner; the decay of that many double integrators; with --arcs also the bounds of a grid with that many
arcs, and with --cascade the rates proved of deep cascades.
"""

import argparse
import resource
import time

import numpy as np

import trigpoint as tp
from trigpoint.certificates import Convergence, SmallestEigenvalue, certify, verify
from trigpoint.observers.network import DiffusiveObserver


def seconds(work):
    start = time.process_time()
    result = work()
    return time.process_time() - start, result


def memory():
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0**2


def line(name, took, checked, text):
    print(f"{name:34s} {took:8.2f} {checked:8.2f} {memory():7.2f}  {text}", flush=True)


def judge(name, problem, observer, claim):
    took, certificate = seconds(lambda: certify(problem, observer, [claim]))
    checked, verdict = seconds(lambda: verify(certificate, problem, observer))
    (record,) = certificate.records
    assert verdict.outcome == record.verdict
    return took, checked, record, name


def chain(n):
    problem = tp.NetworkedAgents(tp.graphs.chain(n), tp.LinearAgent.static())
    observer = tp.design(problem, tp.methods.LocalKalman())
    took, checked, record, name = judge(f"chain of {n}", problem, observer, SmallestEigenvalue())
    exact = 4.0 * np.sin(np.pi / (4.0 * n + 2.0)) ** 2
    text = f"{record.verdict}: lower bound {1.0 - record.numbers['lower'] / exact:.1e} below the closed form"
    line(name, took, checked, text)


def grid(rows, columns, moving):
    graph = tp.graphs.grid(rows, columns, anchors=(0,))
    agent = tp.LinearAgent([[0.0, 1.0], [0.0, 0.0]], [[1.0, 0.0]]) if moving else tp.LinearAgent.static()
    problem = tp.NetworkedAgents(graph, agent)
    observer = tp.design(problem, tp.methods.LocalKalman())
    claim = Convergence() if moving else SmallestEigenvalue()
    took, checked, record, name = judge(f"grid {rows} x {columns}: {claim.name}", problem, observer, claim)
    if moving:
        text = f"{record.verdict}: rate {record.numbers['rate']:.9g} /s"
    else:
        low, high = record.numbers["lower"], record.numbers["upper"]
        text = f"{record.verdict}: [{low:.12g}, {high:.12g}], {(high - low) / low:.1e} wide, {graph.n_arcs} arcs"
    line(name, took, checked, text)


def widest(arcs):
    """The claim alone, without the documents and digests of a certificate (millions of names)."""
    side = round(float(np.sqrt(arcs / 2.0)))
    graph = tp.graphs.grid(side, side, anchors=(0,))
    problem = tp.NetworkedAgents(graph, tp.LinearAgent.static())
    observer = DiffusiveObserver("given", problem, np.eye(1), 1.0, 0.0, None)
    took, record = seconds(lambda: SmallestEigenvalue().check(problem, observer))
    checked, outcome = seconds(lambda: SmallestEigenvalue.verify(record, problem, observer))
    low, high = record.numbers["lower"], record.numbers["upper"]
    text = f"{outcome}: [{low:.12g}, {high:.12g}], {(high - low) / low:.1e} wide, {graph.n_arcs} arcs"
    line(f"grid {side} x {side}, claim alone", took, checked, text)


def cascade(agents, n, ring):
    rng = np.random.default_rng(2)
    T = np.linalg.qr(rng.standard_normal((n, n)))[0]
    A = T @ np.diag(np.linspace(-0.3, 0.2, n)) @ T.T
    outputs = [T[:, [i % n]].T for i in range(agents)]
    hears = {i: {(i - 1) % agents} for i in range(agents)}
    if not ring:
        hears = {i: {*hears[i], *(int(j) for j in rng.choice(agents, 3) if j != i)} for i in range(agents)}
    problem = tp.SharedPlant(A, outputs, {i: sorted(found) for i, found in hears.items()})
    observer = tp.design(problem, tp.methods.SpectrumAssignment(np.linspace(-4.0, -1.0, agents * n)))
    took, checked, record, name = judge(
        f"cascade ({agents}, {n}), {'ring' if ring else 'drawn'}", problem, observer, Convergence()
    )
    line(name, took, checked, f"{record.verdict}: rate {record.numbers['rate']:.6g} of 1 /s assigned")


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--rows", type=int, default=1000)
    parser.add_argument("--arcs", type=float, default=0.0)
    parser.add_argument("--cascade", action="store_true")
    options = parser.parse_args()
    print(f"{'':34s} {'certify':>8s} {'verify':>8s} {'GiB':>7s}")
    chain(2000)
    grid(options.rows, options.rows, moving=False)
    grid(options.rows, options.rows, moving=True)
    if options.arcs:
        widest(options.arcs)
    if options.cascade:
        for agents, n, ring in ((20, 6, True), (50, 10, False), (50, 10, True)):
            cascade(agents, n, ring)


if __name__ == "__main__":
    main()
