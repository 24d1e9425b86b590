"""What a node knows of itself by its neighbours' words: how far an anchor is, since when, and how sure it is."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

_LARGEST_EXPONENT = 200.0


@dataclass(frozen=True)
class Knowledge:
    """Self-knowledge of one node.

    Attributes:
        hops: arcs to the nearest anchor; -1 where none is known.
        evidence: time of the freshest anchor reading that is known of; 0 for never.
        broken: time at which an arc was last missing anywhere that is known of; 0 for never.
        uncertainty: root mean square error of one state that the estimate is believed to have, in the state's unit.
        told: when, by the own clock, a later ``broken`` than all before became known; 0 for never.
    """

    hops: float = -1.0
    evidence: float = 0.0
    broken: float = 0.0
    uncertainty: float = 1.0
    told: float = 0.0

    def anchored(self, now: float, timeout: float) -> bool:
        """True while some anchor reading is at most ``timeout`` seconds old at ``now``."""
        return self.evidence > 0.0 and now - self.evidence <= timeout

    def whole(self, now: float, timeout: float) -> bool:
        """True when no news of a missing arc has come for more than ``timeout`` seconds at ``now``.

        News count by when they come, however old they are: while an arc is missing somewhere they go on to come.
        """
        return self.told == 0.0 or now - self.told > timeout

    @property
    def facts(self) -> tuple[float, float, float, float]:
        """As an ESTIMATE frame carries them."""
        return self.hops, self.evidence, self.broken, self.uncertainty


@dataclass(frozen=True)
class Hearsay:
    """What one neighbour that the node takes part with says of itself; see ``Knowledge``."""

    hops: float
    evidence: float
    broken: float


def learn(
    known: Knowledge, now: float, timeout: float, *, own: float, missing: bool, told: Iterable[Hearsay]
) -> Knowledge:
    """What the node knows at ``now``, after one exchange.

    ``evidence = max(what was known, own, that of the neighbours)``, never above ``now``; ``hops`` is 0 with an own
    fresh reading, else one more than the least of neighbours whose evidence is fresh; ``broken = now`` while an own arc
    is missing, else the latest that is known.

    Args:
        known: what was known before.
        now: seconds.
        timeout: seconds for which evidence is fresh.
        own: time of the freshest reading of an own anchor that is in use; 0 for none.
        missing: whether an own arc is left out.
        told: the neighbours at the other ends of arcs in use.

    We assume:
        * the times in ``told`` were cut off at the instant at which they were heard (``Link.take`` does).

    Nothing here makes evidence younger: each value is the time stamp of a reading, passed on. So after the last anchor
    reading every node stops to be ``anchored`` within ``timeout``, on whatever paths the words travel (no counting to
    infinity): docs/explanation/self-knowledge.md.
    """
    heard = tuple(told)
    evidence = min(now, max([known.evidence, own, *(one.evidence for one in heard)]))
    broken = now if missing else min(now, max([known.broken, *(one.broken for one in heard)]))
    hops = known.hops
    near = [one.hops for one in heard if one.hops >= 0.0 and now - one.evidence <= timeout]
    if own > 0.0:
        hops = 0.0
    elif near:
        hops = 1.0 + min(near)
    if not (evidence > 0.0 and now - evidence <= timeout):
        hops = -1.0
    told_at = now if broken > known.broken else known.told
    return replace(known, hops=hops, evidence=evidence, broken=broken, told=told_at)


@dataclass(frozen=True)
class Pull:
    """One arc in use: its ``rate`` d = trace(gain C) / p [1/s], and the uncertainty of what it pulls towards."""

    rate: float
    uncertainty: float


def averaged(uncertainty: float, pulls: Iterable[Pull], duration: float) -> float:
    """The uncertainty after one step: ``e^{-d h} s + (1 - e^{-d h}) / d sum_k d_k s_k`` with ``d = sum_k d_k``.

    Args:
        uncertainty: s before the step.
        pulls: the arcs in use, d_k and s_k (of the neighbour plus of the reading).
        duration: h [s].

    For static agents with output C = I, gains that are multiples of I and the exchange ``held`` this is a bound: the
    step is ``e+ = e^{-d h} e + (1 - e^{-d h}) / d sum_k d_k (e_k + v_k)``, a mean of vectors with weights that are not
    negative and sum to one; so by Minkowski's inequality its root mean square, and its length, is at most the same
    mean of theirs. By induction over all steps of all nodes ``|e_i| <= s_i`` holds for ever if it holds at the start
    and the readings' errors stay within their deviations; the same with root mean squares, whatever the correlations.
    For others see ``cautious``.
    """
    total, pulled = 0.0, 0.0
    for pull in pulls:
        rate = max(0.0, pull.rate)
        total += rate
        pulled += rate * pull.uncertainty
    if total * duration <= 0.0:
        return uncertainty
    kept = math.exp(-total * duration)
    return kept * uncertainty + (1.0 - kept) / total * pulled


def cautious(uncertainty: float, pulls: Sequence[Pull], duration: float, *, rate: float, growth: float) -> float:
    """The uncertainty of what moves, after one step: ``max(averaged, e^{-rate h} s)``; alone, ``e^{growth h} s``.

    Outputs show a part of such a state only, so that the arcs pull less than ``d_k`` says; the figure falls no faster
    than the whole network does.

    Args:
        uncertainty: s before the step.
        pulls: the arcs in use; where there is none the error moves freely.
        duration: h [s].
        rate: what the network's errors fall by, 1/s; 0 while nobody knows.
        growth: ``free_growth`` of the node's dynamics, 1/s.
    """
    if not pulls:
        return uncertainty * math.exp(min(growth * duration, _LARGEST_EXPONENT))
    return max(averaged(uncertainty, pulls, duration), uncertainty * math.exp(-rate * duration))
