"""Steps 2 to 5 for one part, in their order, with a note on each step that did not succeed."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from trigpoint.analysis.fixed_modes import fixed_modes
from trigpoint.arrays import FloatArray
from trigpoint.errors import MissingExtraError
from trigpoint.linalg.equations import spectral_abscissa
from trigpoint.methods.heterogeneous.abscissa import minimise_abscissa
from trigpoint.methods.heterogeneous.dynamic import Compensator, closed_loop, dynamic_stabiliser
from trigpoint.methods.heterogeneous.inequality import LARGEST, MODERATE, block_inequality
from trigpoint.methods.heterogeneous.marginal import is_marginal, marginal_gain
from trigpoint.methods.heterogeneous.parts import Part
from trigpoint.methods.heterogeneous.polish import quiet_gain
from trigpoint.methods.heterogeneous.semidefinite import engine

DENSE_LIMIT = 600
"""Above so many states no spectrum is computed, and only marginal parts are designed."""

_SEARCH_LIMIT = 200
_TARGET = 0.1
_CLEAR = 1e-6
_ROUNDING = 1e-12
_CHANNELS, _CHANNEL_STATES = 8, 24


@dataclass(frozen=True)
class Choices:
    """What the method was told: ``only`` one step or None, gamma of step 2, starts and seed of step 4."""

    only: str | None
    gamma: float | None
    starts: int
    seed: int

    def wants(self, step: str) -> bool:
        """Is the ``step`` to be tried?"""
        return self.only in (None, step)


@dataclass(frozen=True, eq=False)
class PartDesign:
    """The design of one part.

    Attributes:
        part: the part.
        step: the step that succeeded; None where none did.
        gain: L of the part, in its units, structured.
        abscissa: computed for ``A + L C`` (with the compensator's states), 1/s; None above 600 states.
        compensator: of step 5, without units; else None.
        notes: why earlier steps did not succeed.
        facts: numbers of the steps: gammas, residuals, number of starts.
        Z: certificate in the part's coordinates that no block-diagonal P exists, or None.
    """

    part: Part
    step: str | None
    gain: FloatArray
    abscissa: float | None
    compensator: Compensator | None = None
    notes: tuple[str, ...] = ()
    facts: dict[str, Any] = field(default_factory=dict)
    Z: FloatArray | None = None


def design_part(part: Part, choices: Choices) -> PartDesign:
    """Go through the steps until one gives an L with ``A + L C`` Hurwitz, as ``choices`` say.

    Raises:
        MissingExtraError: only step 3 is wanted for the ``part``, and its engine is not installed.
    """
    notes: list[str] = []
    facts: dict[str, Any] = {}
    if choices.wants("marginal"):
        found = _marginal(part, choices, notes)
        if found is not None:
            return found
    gain, Z = None, None
    if choices.wants("inequality"):
        gain, Z = _inequality(part, choices, notes, facts)
    if gain is not None and (facts["inequality_gamma"] <= MODERATE or choices.only == "inequality"):
        return _finished(part, "inequality", gain, notes, facts, Z)
    found = _searched(part, choices, notes, facts, Z)
    if gain is not None and found.step != "abscissa":
        return _finished(part, "inequality", gain, notes, facts, Z)
    return found


def _searched(
    part: Part, choices: Choices, notes: list[str], facts: dict[str, Any], Z: FloatArray | None
) -> PartDesign:
    """Steps 4 and 5, and the design without a step where they fail, too."""
    A, C = part.scaled()
    start = np.where(part.mask, -C.T, 0.0)
    if A.shape[0] > _SEARCH_LIMIT:
        notes.append(f"steps 4 and 5 left out: {A.shape[0]} states of one part, at most {_SEARCH_LIMIT}")
        return PartDesign(part, None, part.unscaled(start), None, None, tuple(notes), facts, Z)
    if choices.wants("abscissa"):
        search = minimise_abscissa(A, C, part.mask, _TARGET, choices.starts, choices.seed)
        facts["starts"], start = search.starts, search.gain
        if search.abscissa < -_CLEAR:
            return _finished(part, "abscissa", _quietened(A, C, part, search.gain), notes, facts, Z)
        notes.append(f"abscissa: {search.starts} starts got no further left than {search.abscissa * part.size:.3g} /s")
    if choices.wants("dynamic"):
        made = dynamic_stabiliser(A, C, part.mask, part.states, start, choices.seed)
        if made is not None:
            gain, compensator = made
            notes.append(f"dynamic: node {part.nodes[compensator.agent]} carries {A.shape[0]} further states")
            return _finished(part, "dynamic", gain, notes, facts, Z, compensator)
        notes.append("dynamic: no stabiliser through one agent found")
    return PartDesign(part, None, part.unscaled(start), None, None, tuple(notes), facts, Z)


def _quietened(A: FloatArray, C: FloatArray, part: Part, gain: FloatArray) -> FloatArray:
    """The gain after descent on the steady variance, if that leaves a clear decay."""
    quiet = quiet_gain(A, C, part.mask, gain)
    return quiet if spectral_abscissa(A + quiet @ C) < -_CLEAR else gain


def _finished(
    part: Part,
    step: str,
    scaled_gain: FloatArray,
    notes: list[str],
    facts: dict[str, Any],
    Z: FloatArray | None,
    compensator: Compensator | None = None,
) -> PartDesign:
    A, C = part.scaled()
    H = A + scaled_gain @ C
    closed = H if compensator is None else closed_loop(H, C, part.states, compensator)
    abscissa = part.size * spectral_abscissa(closed)
    return PartDesign(part, step, part.unscaled(scaled_gain), abscissa, compensator, tuple(notes), facts, Z)


def _marginal(part: Part, choices: Choices, notes: list[str]) -> PartDesign | None:
    if not is_marginal(part):
        notes.append("marginal: not all unstable modes are semisimple ones on the imaginary axis")
        return None
    gain, facts = marginal_gain(part, choices.gamma)
    gain = np.where(part.mask, gain, 0.0)
    if part.A.shape[0] > DENSE_LIMIT:
        return PartDesign(part, "marginal", gain, None, None, (), facts)
    abscissa = spectral_abscissa(part.A + gain @ part.C)
    if abscissa < -_ROUNDING * part.size:
        return PartDesign(part, "marginal", gain, abscissa, None, (), facts)
    notes.append(f"marginal: rounding leaves the computed abscissa at {abscissa:.3g} /s")
    return None


def _inequality(
    part: Part, choices: Choices, notes: list[str], facts: dict[str, Any]
) -> tuple[FloatArray | None, FloatArray | None]:
    """The gain (without units) and the certificate Z: at most one of them is not None."""
    if part.A.shape[0] > LARGEST:
        notes.append(f"inequality left out: {part.A.shape[0]} states of one part, at most {LARGEST}")
        return None, None
    try:
        module = engine("the block-diagonal Lyapunov inequality of Heterogeneous")
    except MissingExtraError:
        if choices.only == "inequality":
            raise
        notes.append("inequality left out: the extra 'lmi' is not installed")
        return None, None
    A, C = part.scaled()
    found = block_inequality(module, A, C, part.states)
    facts["inequality_margin"] = found.margin
    if found.gain is None:
        proof = "proved by Z" if found.Z is not None else "or only within the solver's accuracy"
        notes.append(f"inequality: no block-diagonal P, {proof} (margin {found.margin:.3g})")
        return None, found.Z
    gain = np.where(part.mask, found.gain, 0.0)
    if spectral_abscissa(A + gain @ C) < -_ROUNDING:
        facts["inequality_gamma"] = found.gamma
        if found.gamma > MODERATE:
            notes.append(f"inequality: P exists, with large gains only (gamma {found.gamma:.3g}); tried the search")
        return gain, None
    notes.append("inequality: the gain found does not stabilise at working precision")
    return None, None


def fixed_mode_verdict(part: Part) -> str:
    """Does a decentralized stabiliser exist for the ``part``? Channel k: agent k's states and the readings it uses.

    Source: WangDavison1973.
    """
    count, n = part.states.count, part.A.shape[0]
    if count > _CHANNELS or n > _CHANNEL_STATES:
        return f"decentralized fixed modes not computed for {count} agents with {n} unstable states"
    A, C = part.scaled()
    inputs = [np.eye(n)[:, part.states.slice(k)] for k in range(count)]
    outputs = [C[part.mask[part.states.slice(k)].any(axis=0)] for k in range(count)]
    modes = [mode for mode in fixed_modes(A, inputs, outputs) if mode.value.real >= -_CLEAR]
    if not modes:
        return "no unstable decentralized fixed mode, so that some decentralized stabiliser exists"
    listed = ", ".join(f"{mode.value * part.size:.4g}{'' if mode.fixed else ' (undecided)'}" for mode in modes)
    return f"unstable decentralized fixed modes: {listed}"
