"""Runs as NetCDF and Zarr: everything comes back, and damage is named."""

from __future__ import annotations

import builtins
import subprocess
import sys
import zipfile

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


def refused(path) -> None:
    with pytest.raises(FileFormatError, match="is not a recorded run"):
        tp.load(path)


@pytest.mark.parametrize("share", [0.02, 0.3, 0.9, 0.999])
@pytest.mark.parametrize("suffix", [".nc", ".zarr"])
def test_cut_files_are_named(suffix, share, tmp_path) -> None:
    path = tmp_path / f"run{suffix}"
    tp.save(recorded(), path)
    data = path.read_bytes()
    path.write_bytes(data[: int(share * len(data))])
    refused(path)


@pytest.mark.parametrize(
    ("name", "spoiled"),
    [
        (".zgroup", None),
        (".zattrs", b"{"),
        (".zattrs", b"{}"),
        (".zattrs", b'{"trigpoint_run": "no JSON"}'),
        (".zattrs", b'{"trigpoint_run": 3}'),
        (".zattrs", b'{"trigpoint_run": "[]"}'),
        (".zattrs", b'{"trigpoint_run": "{\\"path\\": 1, \\"attributes\\": 3}"}'),
        (".zattrs", b"\xff\xfe"),
        ("truth/.zarray", None),
        ("truth/.zarray", b"[]"),
        ("truth/.zarray", lambda text: text.replace(b'"<f8"', b'"<q9"')),
        ("truth/.zarray", lambda text: text.replace(b'"blosc"', b'"bl0sc"').replace(b'"zstd"', b'"zst9"')),
        ("truth/.zarray", lambda text: text.replace(b"9,", b"99999999999999,", 1)),
        ("truth/.zarray", lambda text: text.replace(b"9,", b"8,", 1)),
        ("truth/0.0.0", b"123"),
        ("truth/0.0.0", lambda data: data[:-7]),
        ("truth/0.0.0", lambda data: data[:16] + bytes(32) + data[48:]),
        ("status/.zarray", lambda text: text.replace(b'"vlen-utf8"', b'"vlen-utf9"')),
        ("status/0.0", b"\x01"),
    ],
)
def test_a_zarr_file_with_a_damaged_part_is_named(name, spoiled, tmp_path) -> None:
    """Each part whole for the archive, and wrong for what it says."""
    path = tmp_path / "run.zarr"
    tp.save(recorded(), path)
    with zipfile.ZipFile(path) as archive:
        parts = {part: archive.read(part) for part in archive.namelist()}
    before = parts.pop(name)
    with zipfile.ZipFile(path, "w") as archive:
        for part, data in parts.items():
            archive.writestr(part, data)
        if spoiled is not None:
            changed = spoiled(before) if callable(spoiled) else spoiled
            assert changed != before
            archive.writestr(name, changed)
    refused(path)


FUZZ = """
import os, random, signal, sys, warnings
from pathlib import Path
path, count = Path(sys.argv[1]), int(sys.argv[2])
import trigpoint as tp
from trigpoint.io import run_tables
run_tables.tables()
whole, drawn, found = path.read_bytes(), random.Random(3), {}
for _ in range(count):
    data = bytearray(whole)
    at, size = drawn.randrange(len(data)), drawn.choice([1, 1, 4, 16, 64])
    kind = drawn.randrange(4)
    if kind == 0:
        data[at:at + size] = drawn.randbytes(min(size, len(data) - at))
    elif kind == 1:
        data[at:at + size] = bytes(min(size, len(data) - at))
    elif kind == 2:
        del data[at:at + size]
    else:
        data[at:at] = drawn.randbytes(size)
    path.write_bytes(data)
    child = os.fork()
    if child == 0:
        signal.alarm(5)
        code = 0
        try:
            warnings.simplefilter("ignore")
            tp.load(path)
        except tp.FileFormatError:
            code = 1
        except BaseException as error:
            print(type(error), error, flush=True)
            code = 2
        os._exit(code)
    status = os.waitpid(child, 0)[1]
    word = "hung" if os.WIFSIGNALED(status) else ("read", "refused", "broken")[os.WEXITSTATUS(status)]
    found[word] = found.get(word, 0) + 1
print(found.get("read", 0), found.get("refused", 0), found.get("broken", 0), found.get("hung", 0))
"""


@pytest.mark.slow
@pytest.mark.parametrize("suffix", [".nc", ".zarr"])
def test_whatever_is_damaged_is_refused_or_read(suffix, tmp_path) -> None:
    """No other exception. Of one damaged NetCDF file in a hundred the HDF5 library itself makes no end."""
    path = tmp_path / f"run{suffix}"
    tp.save(recorded(), path)
    command = [sys.executable, "-c", FUZZ, str(path), "300"]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    read, refusals, broken, hung = map(int, done.stdout.split("\n")[-2].split())
    print(f"{suffix}: {read} read, {refusals} refused, {hung} without an end")
    assert broken == 0, done.stdout
    assert refusals > 150
    assert hung <= (12 if suffix == ".nc" else 0)


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
