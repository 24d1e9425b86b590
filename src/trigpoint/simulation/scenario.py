"""What happens in a simulation: times, start, exchange, noise, loss. Pure values."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from trigpoint.arrays import FloatArray, as_floats
from trigpoint.errors import ArgumentError

Path = Literal["auto", "stacked", "modal", "reference"]
_PATHS = ("auto", "stacked", "modal", "reference")


@dataclass(frozen=True)
class Noise:
    """Random disturbances of a sampled run.

    Args:
        measurement: standard deviation of the error of every reading, drawn anew at each exchange.
        process: factor on the agents' process noise ``E v`` (v white, unit intensity), discretized exactly; 0 for none.
    """

    measurement: float = 0.0
    process: float = 0.0

    def __post_init__(self) -> None:
        """Refuse negative and non-finite sizes."""
        for name, value in (("measurement", self.measurement), ("process", self.process)):
            if not (np.isfinite(value) and value >= 0):
                raise ArgumentError(f"noise {name} must be a number of at least 0; got {value}")


@dataclass(frozen=True)
class Channel:
    """What the links do to messages.

    Args:
        loss: probability that one message to one neighbour is lost, 0 <= loss < 1; drawn for each message.
    """

    loss: float = 0.0

    def __post_init__(self) -> None:
        """Check the probability."""
        if not 0.0 <= self.loss < 1.0:
            raise ArgumentError(f"loss must be a probability, 0 <= loss < 1; got {self.loss}")


@dataclass(frozen=True, eq=False)
class Scenario:
    """One experiment.

    Args:
        times: (T,) output times in seconds, ascending, the first at least 0; come back exactly as given.
        initial_error: estimate minus truth at time 0: a scalar for all, (N n,) or (N, n).
        initial_state: truth at time 0: a scalar, (N n,) or (N, n).
        period: seconds between two exchanges of messages; None for continuous exchange.
        noise: random disturbances (sampled runs); None for none.
        channel: message loss (sampled runs); None for none.
        inputs: (N, m) known inputs, constant in time; None for none.
        measurements: (M, p) recorded readings, constant in time, instead of simulated ones (static states only).
        seed: of everything random; equal seeds give equal runs.
        path: ``stacked`` (sparse matrices), ``modal`` (equal agents mode by mode, continuous exchange), ``reference``
            (each local observer by itself, with messages), or ``auto``.

    Raises:
        ArgumentError: times that do not ascend, a period that is not positive, an unknown path, noise or loss
            without a period.
    """

    times: FloatArray
    initial_error: FloatArray
    initial_state: FloatArray
    period: float | None
    noise: Noise | None
    channel: Channel | None
    inputs: FloatArray | None
    measurements: FloatArray | None
    seed: int
    path: Path

    def __init__(
        self,
        times: ArrayLike,
        initial_error: ArrayLike = 1.0,
        initial_state: ArrayLike = 0.0,
        *,
        period: float | None = None,
        noise: Noise | None = None,
        channel: Channel | None = None,
        inputs: ArrayLike | None = None,
        measurements: ArrayLike | None = None,
        seed: int = 0,
        path: Path = "auto",
    ) -> None:
        instants = np.atleast_1d(as_floats("times", times))
        if instants.ndim != 1 or not instants.size or instants[0] < 0 or (np.diff(instants) <= 0).any():
            raise ArgumentError("times must be ascending numbers of at least 0, at least one of them")
        if period is not None and not (np.isfinite(period) and period > 0):
            raise ArgumentError(f"period must be a positive number of seconds; got {period}")
        if path not in _PATHS:
            raise ArgumentError(f"path must be one of {', '.join(_PATHS)}; got {path!r}")
        if not (noise is None or isinstance(noise, Noise)) or not (channel is None or isinstance(channel, Channel)):
            raise ArgumentError(
                "noise must be a Noise(measurement=..., process=...) and channel a Channel(loss=...); "
                f"got {noise!r} and {channel!r}"
            )
        if isinstance(seed, bool) or not isinstance(seed, (int, np.integer)) or seed < 0:
            raise ArgumentError(f"seed must be a whole number of at least 0; got {seed!r}")
        if period is None and (noise is not None or channel is not None):
            raise ArgumentError("noise and loss belong to sampled exchange: give a period")
        object.__setattr__(self, "times", instants)
        object.__setattr__(self, "initial_error", as_floats("initial_error", initial_error))
        object.__setattr__(self, "initial_state", as_floats("initial_state", initial_state))
        object.__setattr__(self, "period", None if period is None else float(period))
        object.__setattr__(self, "noise", noise)
        object.__setattr__(self, "channel", channel)
        object.__setattr__(self, "inputs", None if inputs is None else as_floats("inputs", inputs))
        object.__setattr__(
            self, "measurements", None if measurements is None else as_floats("measurements", measurements)
        )
        object.__setattr__(self, "seed", int(seed))
        object.__setattr__(self, "path", path)

    def __repr__(self) -> str:
        exchange = "continuous exchange" if self.period is None else f"exchange every {self.period:g} s"
        return f"Scenario({self.times.shape[0]} times to {self.times[-1]:g} s, {exchange}, seed {self.seed})"
