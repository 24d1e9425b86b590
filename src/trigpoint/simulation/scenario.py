"""What happens in a simulation: times, start, exchange, noise, loss. Pure values."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from trigpoint.arrays import FloatArray, as_floats
from trigpoint.errors import ArgumentError
from trigpoint.simulation.channel import Channel, Trigger
from trigpoint.simulation.clocks import Clocks
from trigpoint.simulation.motion import Bouncing, Trajectory
from trigpoint.simulation.topology import Absence, Topology

Path = Literal["auto", "stacked", "modal", "reference"]
_PATHS = ("auto", "stacked", "modal", "reference")


@dataclass(frozen=True)
class Noise:
    """Random disturbances.

    Args:
        measurement: sampled exchange: standard deviation of the error of every reading, drawn anew at each exchange;
            continuous exchange: square root of the intensity of white noise on every reading.
        process: factor on the agents' process noise ``E v`` (v white, unit intensity), discretized exactly; 0 for none.
    """

    measurement: float = 0.0
    process: float = 0.0

    def __post_init__(self) -> None:
        """Refuse negative and non-finite sizes."""
        for name, value in (("measurement", self.measurement), ("process", self.process)):
            if not (np.isfinite(value) and value >= 0):
                raise ArgumentError(f"noise {name} must be a number of at least 0; got {value}")


_KINDS: dict[str, tuple[type, ...]] = {
    "noise": (Noise,),
    "channel": (Channel,),
    "clocks": (Clocks,),
    "topology": (Topology,),
    "trigger": (Trigger,),
    "motion": (Trajectory, Bouncing),
}


@dataclass(frozen=True, eq=False)
class Scenario:
    """One experiment.

    Args:
        times: (T,) output times in seconds, ascending, the first at least 0; come back exactly as given.
        initial_error: estimate minus truth at time 0: a scalar for all, (N n,) or (N, n).
        initial_state: truth at time 0: a scalar, (N n,) or (N, n).
        period: seconds between two exchanges of messages; None for continuous exchange.
        noise: random disturbances; None for none.
        channel: loss, delay, rounding of messages (sampled runs); None for none.
        clocks: when each node acts and what its clock shows (sampled runs); None for one clock.
        topology: which arcs work when; None for all, always.
        absences: nodes that are away for a while.
        trigger: nodes send only when there is something to say (sampled runs); None: at every exchange.
        gossip: at each exchange one random arc is met exactly by its two ends, and nothing else happens (constants).
        motion: the truth, known to the agents as their own input; None: it follows their dynamics.
        inputs: (N, m) known inputs, constant in time; None for none.
        measurements: (M, p) recorded readings, constant in time, instead of simulated ones (static states only).
        seed: of everything random; equal seeds give equal runs.
        path: ``stacked`` (sparse matrices), ``modal`` (equal agents mode by mode, continuous exchange), ``reference``
            (each local observer by itself, with messages), or ``auto``.
        tolerance: error that the modal path may make on networks of more than 1200 nodes, relative to the first error;
            what was reached is estimated in the run's attributes.

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
    clocks: Clocks | None
    topology: Topology | None
    absences: tuple[Absence, ...]
    trigger: Trigger | None
    gossip: bool
    motion: Trajectory | Bouncing | None
    inputs: FloatArray | None
    measurements: FloatArray | None
    seed: int
    path: Path
    tolerance: float

    def __init__(
        self,
        times: ArrayLike,
        initial_error: ArrayLike = 1.0,
        initial_state: ArrayLike = 0.0,
        *,
        period: float | None = None,
        noise: Noise | None = None,
        channel: Channel | None = None,
        clocks: Clocks | None = None,
        topology: Topology | None = None,
        absences: Sequence[Absence] = (),
        trigger: Trigger | None = None,
        gossip: bool = False,
        motion: Trajectory | Bouncing | None = None,
        inputs: ArrayLike | None = None,
        measurements: ArrayLike | None = None,
        seed: int = 0,
        path: Path = "auto",
        tolerance: float = 1e-8,
    ) -> None:
        instants = np.atleast_1d(as_floats("times", times))
        if instants.ndim != 1 or not instants.size or instants[0] < 0 or (np.diff(instants) <= 0).any():
            raise ArgumentError("times must be ascending numbers of at least 0, at least one of them")
        if period is not None and not (np.isfinite(period) and period > 0):
            raise ArgumentError(f"period must be a positive number of seconds; got {period}")
        _check_engine(path, tolerance, seed)
        given = {
            "noise": noise, "channel": channel, "clocks": clocks, "topology": topology, "trigger": trigger,
            "motion": motion,
        }  # fmt: skip
        for name, value in given.items():
            if value is not None and not isinstance(value, _KINDS[name]):
                wanted = " or ".join(f"{kind.__name__}(...)" for kind in _KINDS[name])
                raise ArgumentError(f"{name} must be {wanted}; got {value!r}")
        if not all(isinstance(one, Absence) for one in absences):
            raise ArgumentError(f"absences must hold Absence(node, start, stop); got {absences!r}")
        alone = [name for name in ("channel", "clocks", "trigger") if given[name] is not None] + ["gossip"] * gossip
        if period is None and alone:
            verb = "needs" if alone in (["channel"], ["trigger"], ["gossip"]) else "need"
            raise ArgumentError(f"{' and '.join(alone)} {verb} sampled exchange: give a period")
        if trigger is not None and (channel is None or channel.old == "drop"):
            raise ArgumentError("with a trigger silence means no news: give channel=Channel(old='propagate') or 'use'")
        if motion is not None and noise is not None and noise.process > 0.0:
            raise ArgumentError("a given motion has no process noise: give one of the two")
        object.__setattr__(self, "times", instants)
        object.__setattr__(self, "initial_error", as_floats("initial_error", initial_error))
        object.__setattr__(self, "initial_state", as_floats("initial_state", initial_state))
        object.__setattr__(self, "period", None if period is None else float(period))
        for name, value in given.items():
            object.__setattr__(self, name, value)
        object.__setattr__(self, "absences", tuple(absences))
        object.__setattr__(self, "gossip", bool(gossip))
        object.__setattr__(self, "inputs", None if inputs is None else as_floats("inputs", inputs))
        object.__setattr__(
            self, "measurements", None if measurements is None else as_floats("measurements", measurements)
        )
        object.__setattr__(self, "seed", int(seed))
        object.__setattr__(self, "path", path)
        object.__setattr__(self, "tolerance", float(tolerance))

    @property
    def lossy(self) -> bool:
        """True where some message may not arrive."""
        return self.channel is not None and not self.channel.is_certain

    @property
    def needs_events(self) -> bool:
        """True where nodes act or hear one another at different times, or only some of them do."""
        varied = self.clocks is not None or self.trigger is not None or bool(self.absences)
        return varied or self.lossy or (self.topology is not None and self.period is not None)

    def __repr__(self) -> str:
        exchange = "continuous exchange" if self.period is None else f"exchange every {self.period:g} s"
        return f"Scenario({self.times.shape[0]} times to {self.times[-1]:g} s, {exchange}, seed {self.seed})"


def _check_engine(path: str, tolerance: float, seed: int) -> None:
    if path not in _PATHS:
        raise ArgumentError(f"path must be one of {', '.join(_PATHS)}; got {path!r}")
    if not 1e-14 <= tolerance < 1.0:
        raise ArgumentError(f"tolerance must be a relative error of at least 1e-14 and below 1; got {tolerance}")
    if isinstance(seed, bool) or not isinstance(seed, (int, np.integer)) or seed < 0:
        raise ArgumentError(f"seed must be a whole number of at least 0; got {seed!r}")
