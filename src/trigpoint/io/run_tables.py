"""A recorded run as NetCDF (``.nc``) or Zarr (``.zarr``, one zip file): for xarray and everything that reads those."""

from __future__ import annotations

import json
import tempfile
import warnings
import zipfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from trigpoint.errors import ArgumentError, FileFormatError, MissingExtraError
from trigpoint.observers.run import Run

_TABLES = ("messages", "delivered", "bytes", "status")
_DAMAGED = (
    OSError, EOFError, LookupError, RuntimeError, TypeError, ValueError, MemoryError, zipfile.BadZipFile, zlib.error,
)  # fmt: skip
"""What xarray, h5py, zarr and zipfile make of damaged files: found by damaging thousands (tests/io)."""


def read_netcdf(path: str | Path) -> Run:
    """Read a run written as NetCDF; anything else is a ``FileFormatError``.

    Of a hundred files with damage within about one has the HDF5 library itself go round for ever.
    """
    return _read(path, lambda xarray: xarray.open_dataset(Path(path), engine="h5netcdf"))


def read_zarr(path: str | Path) -> Run:
    """Read a run written as Zarr; anything else is a ``FileFormatError``."""
    return _read(path, lambda xarray: xarray.open_zarr(_zip_store(path), consolidated=False))


def netcdf_bytes(run: Any) -> bytes:
    """The bytes of a NetCDF file."""
    return _bytes(run, "run.nc", lambda table, path: table.to_netcdf(path, engine="h5netcdf"))


def zarr_bytes(run: Any) -> bytes:
    """The bytes of a Zarr store in one zip file."""

    def write(table: Any, path: Path) -> None:
        folder = path.with_suffix(".folder")
        table.to_zarr(folder, mode="w", consolidated=False, zarr_format=2)
        with zipfile.ZipFile(path, "w", zipfile.ZIP_STORED) as archive:
            for part in sorted(folder.rglob("*")):
                if part.is_file():
                    archive.write(part, part.relative_to(folder).as_posix())

    return _bytes(run, "run.zarr", write)


def _zip_store(path: str | Path) -> Any:
    from zarr.storage import ZipStore

    return ZipStore(str(path), mode="r")


def tables() -> Any:
    """The package xarray; a ``MissingExtraError`` unless all that writes its tables is there."""
    try:
        import h5netcdf  # noqa: F401
        import h5py  # noqa: F401
        import xarray
        import zarr  # noqa: F401
    except ImportError as error:
        raise MissingExtraError("xarray, h5netcdf, h5py or zarr", "data", "a .nc or .zarr file") from error
    return xarray


def _bytes(run: Any, name: str, write: Any) -> bytes:
    if not isinstance(run, Run):
        raise ArgumentError(f"{Path(name).suffix} holds recorded runs; got a {type(run).__name__}")
    tables()
    table = run.dataset
    table["status"] = table["status"].astype(object)
    table["node"] = table["node"].astype(object)
    header = {"path": run.path, "attributes": dict(run.attributes)}
    table.attrs = {"trigpoint_run": json.dumps(header)}
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / name
        write(table, path)
        return path.read_bytes()


@contextmanager
def _quiet() -> Iterator[None]:
    """Zarr warns of a part that it does not recognise; that the part is missing is said as an error."""
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", category=UserWarning, module="zarr")
        yield


def _read(path: str | Path, opened: Any) -> Run:
    xarray = tables()
    if not Path(path).is_file():
        raise FileFormatError(path, "there is no such file; check the name and the folder")
    try:
        with _quiet(), opened(xarray) as table:
            header = json.loads(table.attrs["trigpoint_run"])
            optional = {name: np.asarray(table[name]) for name in (*_TABLES[1:3], "lambda_min") if name in table}
            return Run(
                np.asarray(table["time"]),
                np.asarray(table["truth"]),
                np.asarray(table["estimate"]),
                np.asarray(table["messages"]),
                np.array(np.asarray(table["status"]).tolist(), dtype=np.str_),
                tuple(str(name) for name in np.asarray(table["node"]).tolist()),
                str(header["path"]),
                dict(header["attributes"]),
                **optional,
            )
    except _DAMAGED as error:
        raise FileFormatError(path, "is not a recorded run written by simulate, or is damaged") from error
