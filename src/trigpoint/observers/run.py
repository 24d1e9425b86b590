"""``Run``: what a simulation or a live run recorded. Arrays only; both producers return the same type."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from trigpoint.arrays import FloatArray, IntArray
from trigpoint.errors import ArgumentError, MissingExtraError, ShapeError

_SERIES = ("bytes", "delivered", "error", "estimate", "lambda_min", "messages", "status", "truth")


@dataclass(frozen=True, eq=False)
class Run:
    """Recorded truth and estimates of every node at the asked times.

    Attributes:
        times: (T,) seconds, exactly as asked for.
        truth: (T, N, n) state of each node.
        estimate: (T, N, n) what each node believed.
        messages: (T, N) messages each node has sent so far.
        status: (T, N) text: ``anchored``, ``relative`` or ``away``.
        names: N node names.
        path: which engine ran (``stacked``, ``reference``, ``processes``).
        attributes: numbers and texts enough to run it again.
        delivered: (T, N) messages that each node has taken in so far; None where the path does not count them.
        bytes: (T, N) bytes that each node has sent so far, or None.
        lambda_min: (T,) smallest eigenvalue of the topology at work at each time, or None.

    ``run["error"]`` and the other series are arrays [time, node, state]; error = estimate - truth.
    """

    times: FloatArray
    truth: FloatArray
    estimate: FloatArray
    messages: IntArray
    status: NDArray[np.str_]
    names: tuple[str, ...]
    path: str
    attributes: Mapping[str, Any] = field(default_factory=dict)
    delivered: IntArray | None = None
    bytes: IntArray | None = None
    lambda_min: FloatArray | None = None

    def __post_init__(self) -> None:
        """Check the shapes once, so that no reader has to."""
        if self.truth.shape != self.estimate.shape or self.truth.ndim != 3:
            raise ShapeError(f"truth {self.truth.shape} and estimate {self.estimate.shape} must both be (T, N, n)")
        expected = (self.times.shape[0], len(self.names))
        for name in ("truth", "messages", "status", "delivered", "bytes"):
            table = getattr(self, name)
            if table is not None and table.shape[:2] != expected:
                raise ShapeError(f"{name} must begin with the shape (T, N) = {expected}; got {table.shape}")

    def __repr__(self) -> str:
        count, nodes, states = self.truth.shape
        norm = self.error_norm
        span = f", error {norm[0]:.4g} -> {norm[-1]:.4g}" if count else ""
        return f"Run({count} times, {nodes} nodes, {states} states, {self.path}{span})"

    @property
    def error(self) -> FloatArray:
        """Estimate minus truth, (T, N, n)."""
        return self.estimate - self.truth

    @property
    def error_norm(self) -> FloatArray:
        """(T,) Euclidean norm of the whole network's error; nodes that are away do not count.

        Nor do nodes whose truth is known at no sample, where that of others is (who joined a live run with a sensor of
        its own). NaN at a sample where the truth of another node that is not away is unknown.
        """
        with np.errstate(over="ignore"):  # a run that diverged has an infinite norm
            norm: FloatArray = np.sqrt((self._present_error**2).sum(axis=(1, 2)))
        return norm

    @property
    def _present_error(self) -> FloatArray:
        blind = np.isnan(self.truth).any(axis=2).all(axis=0)
        left_out = (self.status == "away") | (blind & (not blind.all()))
        return np.where(left_out[:, :, None], 0.0, self.error)

    def __getitem__(self, name: str) -> NDArray[Any]:
        if name not in _SERIES:
            raise ArgumentError(f"a run holds {', '.join(_SERIES)}; got {name!r}")
        series: NDArray[Any] | None = getattr(self, name)
        if series is None:
            raise ArgumentError(f"this run, path {self.path!r}, did not record {name!r}")
        return series

    def time_to(self, level: float) -> float | None:
        """First time after which the error norm stays at or below ``level`` (in the state's unit), or None.

        Between two samples the logarithm of the norm is taken as a straight line. Samples without a known error are
        left out.
        """
        norm = self.error_norm
        known = ~np.isnan(norm)
        times, norm = self.times[known], norm[known]
        above = np.flatnonzero(norm > level)
        if not above.size:
            return float(times[0]) if times.size else None
        last = int(above[-1])
        if last + 1 == norm.shape[0]:
            return None
        before, after = norm[last], max(norm[last + 1], np.finfo(float).tiny)
        share = np.log(before / level) / (np.log(before) - np.log(after)) if level > 0 else 1.0
        return float(times[last] + share * (times[last + 1] - times[last]))

    def measured_decay_rate(self) -> float | None:
        """Slope of -log(error norm), 1/s, over the later half of the samples that are clear of the floor.

        Where the error has settled at a value that is not zero (readings that contradict each other, noise), the
        distance from that value is taken. Samples without a known error are left out. None where fewer than three
        samples are left.
        """
        times, norm = self._clear_of_the_floor()
        if times.shape[0] < 3 or np.ptp(times) == 0.0:
            return None
        return float(-np.polyfit(times, np.log(norm), 1)[0])

    def decay_window(self) -> tuple[float, float] | None:
        """First and last of the times that ``measured_decay_rate`` is taken over; None where it is."""
        times, _ = self._clear_of_the_floor()
        return None if times.shape[0] < 3 or np.ptp(times) == 0.0 else (float(times[0]), float(times[-1]))

    def _clear_of_the_floor(self) -> tuple[FloatArray, FloatArray]:
        """Times and norms of the later half of the samples whose error is known and clear of the floor."""
        norm = self.error_norm
        known = np.isfinite(norm)
        times, norm, error = self.times[known], norm[known], self._present_error[known]
        size = np.sqrt(self.truth.shape[1] * self.truth.shape[2])
        scale = np.abs(self.truth[np.isfinite(self.truth)]).max(initial=0.0) * size + norm.max(initial=0.0)
        floor = 1e-11 * scale
        tail = max(1, norm.shape[0] // 10)
        if norm.shape[0] >= 20 and floor < norm[-tail] <= 1.05 * norm[-1] and norm[-1] <= 0.1 * norm[0]:
            rest = error - error[-tail:].mean(axis=0)
            norm = np.sqrt((rest**2).sum(axis=(1, 2)))
            floor = max(floor, 1e-4 * norm[0], 10.0 * float(np.median(norm[-tail:])))
        usable = np.flatnonzero(norm > floor)
        usable = usable[usable.shape[0] // 2 :]
        return times[usable], norm[usable]

    @property
    def dataset(self) -> Any:
        """The run as an ``xarray.Dataset`` (dimensions time, node, state); needs the extra ``data``."""
        try:
            import xarray
        except ImportError as error:
            raise MissingExtraError("xarray", "data", "run.dataset") from error
        cube = ("time", "node", "state")
        tables: dict[str, Any] = {
            name: (("time", "node"), getattr(self, name))
            for name in ("messages", "delivered", "bytes", "status")
            if getattr(self, name) is not None
        }
        if self.lambda_min is not None:
            tables["lambda_min"] = (("time",), self.lambda_min)
        return xarray.Dataset(
            {"truth": (cube, self.truth), "estimate": (cube, self.estimate), "error": (cube, self.error), **tables},
            coords={"time": self.times, "node": list(self.names), "state": np.arange(self.truth.shape[2])},
            attrs={"path": self.path, **{key: _flat(value) for key, value in self.attributes.items()}},
        )


def _flat(value: Any) -> Any:
    """Nested attributes as JSON text, so that every file format takes them."""
    return json.dumps(value) if isinstance(value, Mapping) else value
