"""``Centralised``: all readings at one place, one observer: the yardstick for the distributed ones."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Literal, get_args

import numpy as np
from numpy.typing import ArrayLike

from trigpoint.analysis.pairs import pair_margin
from trigpoint.arrays import FloatArray, as_matrix, require_finite
from trigpoint.errors import ArgumentError, MethodError, ShapeError
from trigpoint.linalg.equations import filter_riccati, spectral_abscissa
from trigpoint.linalg.injection import assigned_injection, rate_injection, spectrum_error
from trigpoint.methods.base import Method
from trigpoint.model import LinearAgent, SharedPlant
from trigpoint.observers.assembled import AssembledObserver
from trigpoint.observers.centralised import CentralisedObserver, reduced_pair

_NAME = "Centralised"
_BELOW = 1e-6  # a defective rightmost eigenvalue brings powers of t: any rate below its real part holds

Kind = Literal["full", "reduced", "extended"]


@dataclass(frozen=True, eq=False)
class Centralised(Method):
    """One observer that reads every agent's output: full order, least order, or extended by a disturbance model.

    The observer is ``z' = H z + K y + V B u``, ``estimate = M z + N y``. ``full``: order n. ``reduced``: order
    ``n - rank C``, the rest taken from the reading. ``extended``: order ``n + n_bar``, with
    ``x' = A x + B u + c_bar d``, ``d' = a_bar d`` as model, so that a disturbance d of that kind leaves no error.

    Args:
        kind: ``full``, ``reduced`` or ``extended``.
        eigenvalues: the spectrum of H, closed under conjugation, one for each state of the observer; needs an
            observable pair.
        rate: instead of ``eigenvalues``, 1/s: all eigenvalues left of ``-rate`` with gains of moderate size. Without
            either a Kalman gain with process and measurement covariance I.
        extra: (a_bar, c_bar) of shapes (n_bar, n_bar), (n, n_bar); for ``extended`` only.

    We assume:
        * all readings are known where the observer runs: the result belongs to a problem with one agent that has all
          outputs, ``observer.problem``, and simulates on that;
        * the pair is detectable (observable, with ``eigenvalues``).

    Guarantee: ``decay_rate`` is one part in 1e6 less than the distance of H's computed spectrum from the imaginary
    axis.

    Raises:
        ArgumentError, ShapeError: an unknown kind, both eigenvalues and rate, a list that is not closed, a wrong shape.
        MethodError: another kind of problem, a pair that is not observable enough, eigenvalues that cannot be placed,
            a reduced observer where C shows the whole state.

    Cost O(n^3). Source: W17, section III; 002-03.
    """

    label: ClassVar[str] = "centralised"

    kind: Kind = "full"
    eigenvalues: Sequence[complex] | None = None
    rate: float | None = None
    extra: tuple[ArrayLike, ArrayLike] | None = None

    def __post_init__(self) -> None:
        """Check the choices."""
        if self.kind not in get_args(Kind):
            raise ArgumentError(f"kind must be one of {', '.join(get_args(Kind))}; got {self.kind!r}")
        if self.eigenvalues is not None and self.rate is not None:
            raise ArgumentError("give eigenvalues or rate, not both")
        if self.rate is not None and not (np.isfinite(self.rate) and self.rate > 0.0):
            raise ArgumentError(f"rate must be a positive number of 1/s; got {self.rate!r}")
        if (self.kind == "extended") != (self.extra is not None):
            raise ArgumentError("extra = (a_bar, c_bar) belongs to kind='extended', which needs it")
        if self.eigenvalues is not None:
            _check_closed(np.asarray(self.eigenvalues, dtype=complex))

    def build(self, problem: Any) -> AssembledObserver:
        """Return the observer of ``problem`` (its outputs at one place), or raise ``MethodError``."""
        plant = _at_one_place(problem)
        A, C = plant.A, plant.outputs[0]
        observer, pair, gain = self._observer(A, C)
        abscissa = spectral_abscissa(observer.H)
        if not abscissa < -(self.rate or 0.0):
            raise self._refusal(pair, f"an observer that decays at {-abscissa:.3g} 1/s only")
        wanted = None if self.eigenvalues is None else spectrum_error(observer.H, np.asarray(self.eigenvalues))
        residuals = observer.residuals(A, C)
        facts = {
            "kind": self.kind,
            "order": observer.order,
            "gain_size": float(np.abs(gain).max(initial=0.0)),
            "spectrum_error": wanted,
            "dynamics_residual": residuals.dynamics,
            "output_residual": residuals.output,
        }
        node = observer.program(C, plant.B)
        decay = -(1.0 - _BELOW) * abscissa
        return AssembledObserver(self.label, plant, (node,), decay, abscissa, facts, (observer.V,))

    def observer(self, problem: Any) -> CentralisedObserver:
        """The matrices (H, K, M, N, V) for ``problem`` by themselves, without the check that they decay as asked."""
        plant = _at_one_place(problem)
        return self._observer(plant.A, plant.outputs[0])[0]

    def _observer(
        self, A: FloatArray, C: FloatArray
    ) -> tuple[CentralisedObserver, tuple[FloatArray, FloatArray], FloatArray]:
        """The observer, the pair that its gain was designed for, and that gain."""
        if self.kind == "reduced":
            pair = reduced_pair(A, C)
            if not pair[0].size:
                raise MethodError(
                    _NAME,
                    "a state that C does not show at once, for kind='reduced'",
                    "C of full column rank, so that x = pinv(C) y",
                    "Use that, or kind='full' to filter.",
                )
            gain = self._gain(*pair)
            return CentralisedObserver.reduced_order(A, C, gain), pair, gain
        if self.extra is None:
            gain = self._gain(A, C)
            return CentralisedObserver.full_state(A, C, gain), (A, C), gain
        n = A.shape[0]
        inner = as_matrix("a_bar", self.extra[0])
        entry = as_matrix("c_bar", self.extra[1], n, inner.shape[0])
        if inner.shape[0] != inner.shape[1]:
            raise ShapeError(f"a_bar must be square; got shape {inner.shape}")
        wide = np.block([[A, entry], [np.zeros((inner.shape[0], n)), inner]])
        pair = (wide, np.hstack([C, np.zeros((C.shape[0], inner.shape[0]))]))
        gain = self._gain(*pair)
        return CentralisedObserver.extended(A, C, inner, -gain[n:], entry, -gain[:n]), pair, gain

    def _gain(self, A: FloatArray, C: FloatArray) -> FloatArray:
        margin = pair_margin(A, C, unstable_only=self.eigenvalues is None)
        word = "detectable" if self.eigenvalues is None else "observable"
        if margin.verdict is not True:
            raise self._refusal((A, C), f"a pair that is not {word} at s = {margin.mode:.6g}")
        try:
            if self.eigenvalues is not None:
                return self._assigned(A, C)
            if self.rate is not None:
                return rate_injection(A, C, self.rate)
            return np.asarray(filter_riccati(A, C, np.eye(A.shape[0]), np.eye(C.shape[0])) @ C.T)
        except (np.linalg.LinAlgError, ValueError) as error:
            raise self._refusal((A, C), f"this: {error}") from error

    def _assigned(self, A: FloatArray, C: FloatArray) -> FloatArray:
        wanted = np.asarray(self.eigenvalues, dtype=complex)
        if wanted.shape != (A.shape[0],):
            raise MethodError(
                _NAME,
                f"{A.shape[0]} eigenvalues, one a state of the {self.kind} observer",
                f"{wanted.size}",
                "Lengthen or shorten the list.",
            )
        return assigned_injection(A, C, wanted if wanted.imag.any() else wanted.real)

    def _refusal(self, pair: tuple[FloatArray, FloatArray], got: str) -> MethodError:
        n, p = pair[0].shape[0], pair[1].shape[0]
        return MethodError(
            _NAME,
            f"a gain for the pair of {n} states and {p} readings behind kind={self.kind!r}",
            got,
            "Sense more, ask for a lower rate, or repeat no eigenvalue more often than there are independent readings.",
        )


def _at_one_place(problem: Any) -> SharedPlant:
    """The problem with one agent that has all outputs."""
    if isinstance(problem, LinearAgent):
        return SharedPlant(problem.A, [problem.C], {}, problem.B)
    if not isinstance(problem, SharedPlant):
        raise MethodError(
            _NAME,
            "a SharedPlant or a LinearAgent",
            type(problem).__name__,
            "plant_from_control reads a control.StateSpace.",
        )
    if problem.n_agents == 1:
        return problem
    return SharedPlant(problem.A, [problem.stacked_output()], {}, problem.B)


def _check_closed(values: np.ndarray) -> None:
    if values.ndim != 1:
        raise ShapeError(f"eigenvalues must be one list; got shape {values.shape}")
    require_finite("eigenvalues", values)
    upper, lower = (np.sort_complex(part) for part in (values[values.imag > 0], values[values.imag < 0].conj()))
    if upper.shape != lower.shape or not np.allclose(upper, lower, rtol=1e-12, atol=0.0):
        raise ArgumentError(
            f"eigenvalues must come in conjugate pairs, since the observer is real; got {values.tolist()}"
        )
