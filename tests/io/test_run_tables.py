"""Runs as NetCDF and Zarr: everything comes back, and damage is named."""

from __future__ import annotations

import builtins

import numpy as np
import pytest

import trigpoint as tp
from trigpoint.errors import ArgumentError, FileFormatError, MissingExtraError
from trigpoint.simulation import Absence, Topology

GRAPH = tp.graphs.grid(2, 3, anchors=(0,))
PROBLEM = tp.NetworkedAgents(GRAPH, tp.LinearAgent([[0.0, 1.0], [-1.0, 0.0]], [[1.0, 0.0]]))
OBSERVER = tp.design(PROBLEM, tp.methods.LocalKalman())


def recorded() -> tp.Run:
    topology = Topology.random(GRAPH.n_arcs, 0.4, 0.7, 2.0)
    scenario = tp.Scenario(
        np.linspace(0, 2, 9),
        1.0,
        period=0.1,
        channel=tp.Channel(0.2),
        topology=topology,
        absences=[Absence(3, 0.5, 1.0)],
    )
    return tp.simulate(PROBLEM, OBSERVER, scenario)


@pytest.mark.parametrize("suffix", [".nc", ".zarr", ".npz"])
def test_a_run_comes_back_as_it_was(suffix, tmp_path) -> None:
    run, path = recorded(), tmp_path / f"run{suffix}"
    tp.save(run, path)
    back = tp.load(path)
    for name in ("times", "truth", "estimate", "messages", "delivered", "bytes", "lambda_min"):
        assert np.array_equal(getattr(back, name), getattr(run, name), equal_nan=True), name
    assert np.array_equal(back.status, run.status)
    assert (back.names, back.path) == (run.names, run.path)
    assert dict(back.attributes) == dict(run.attributes)


@pytest.mark.parametrize("suffix", [".nc", ".zarr"])
def test_damaged_files_are_named(suffix, tmp_path) -> None:
    path = tmp_path / f"run{suffix}"
    with pytest.raises(FileFormatError, match="no such file"):
        tp.load(path)
    path.write_bytes(b"\x00" * 300)
    with pytest.raises(FileFormatError, match="is not a recorded run"):
        tp.load(path)
    with pytest.raises(ArgumentError, match="holds recorded runs; got a MeasurementGraph"):
        tp.save(GRAPH, path)


@pytest.mark.parametrize(("suffix", "missing"), [(".nc", "h5netcdf"), (".zarr", "zarr")])
def test_without_the_extra_the_message_names_it(suffix, missing, tmp_path, monkeypatch) -> None:
    whole = builtins.__import__

    def without(name, *rest, **options):
        if name == missing:
            raise ImportError(name)
        return whole(name, *rest, **options)

    run = recorded()
    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(MissingExtraError, match="data"):
        tp.save(run, tmp_path / f"run{suffix}")
