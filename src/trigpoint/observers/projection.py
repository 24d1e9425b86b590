"""The program of one node of a hybrid observer: it flows by itself, and at events it projects what it hears.

NumPy, the arrays and ``observers.local`` only: a deployed node can carry it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from trigpoint.arrays import FloatArray, frozen
from trigpoint.errors import ArgumentError
from trigpoint.observers.local import LocalObserver, LocalState, Message


@dataclass(frozen=True, eq=False)
class ProjectionProgram:
    """One node of a hybrid observer: ``z = (w, x)``, w its own estimate of ``seen' x`` and x that of the whole state.

    Between events ``flow`` moves both: w as an observer of what the node sees, x by the plant's model. At an event a
    number of rounds ``x <- (I - seen seen') average + seen w`` follow each other, the average taken over the node's own
    x and those that it hears in that round: the nearest state to the average that agrees with its own observer.

    Args:
        flow: the program between events, (k + n) states, w first; its readout is x.
        seen: (n, k) orthonormal basis of what the node sees.

    We assume:
        * every message of a round belongs to that round (all nodes make their rounds together).

    Source: theory 4b-B3.
    """

    flow: LocalObserver
    seen: FloatArray

    @property
    def name(self) -> str:
        """The node's name."""
        return self.flow.name

    @property
    def n_seen(self) -> int:
        """Number k of directions that the node sees."""
        return int(self.seen.shape[1])

    def init(self, estimate: FloatArray | None = None, time: float = 0.0) -> LocalState:
        """First state at ``time`` from a guess ``estimate`` (n,), or from zero; w is what the guess shows."""
        n = self.seen.shape[0]
        guess = np.zeros(n) if estimate is None else np.asarray(estimate, dtype=np.float64)
        if guess.shape != (n,):
            raise ArgumentError(f"estimate of node {self.name!r} must have shape ({n},); got {guess.shape}")
        return self.flow.init(np.concatenate([self.seen.T @ guess, guess]), time)

    def estimate(self, state: LocalState) -> FloatArray:
        """The node's estimate x (n,) in ``state``."""
        return state.estimate[self.n_seen :]

    def emit(self, state: LocalState) -> Message:
        """The message of one round: x, and not w, of ``state``."""
        return Message(self.name, state.sequence, state.time, self.estimate(state))

    def round(self, state: LocalState, inbox: Mapping[str, Message]) -> LocalState:
        """The state after one round with the messages in ``inbox``, whoever sent them; no time passes.

        Own word and each message count alike. Cost O(n (k + messages)).
        """
        heard = [message.estimate for name, message in sorted(inbox.items()) if name != self.name]
        average = (self.estimate(state) + sum(heard, np.zeros(self.seen.shape[0]))) / (1 + len(heard))
        own = state.estimate[: self.n_seen]
        corrected = average + self.seen @ (own - self.seen.T @ average)
        return replace(state, sequence=state.sequence + 1, estimate=frozen(np.concatenate([own, corrected])))
