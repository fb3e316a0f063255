"""When a loop oscillated: spans of a record, some cycles long, and what share of the time they take.

The long-run votes of `oscillation` need a level's blocks; a record of five cycles has none, and hunting by the hour is
outvoted by the quiet in between. Here each span of five cycles or more is found for itself
(`swing_windows`), with its start and end, and spans are put together over a loop's consecutive blocks.

An oscillation is not told from a load that swings by itself; whose it is, `cycle_gain` and the tuning tell.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from monitor.compiled import jit

from .swing_windows import FINEST_AVERAGES, SAME_PERIOD_RATIO, WINDOW_CYCLES, runs_of

Array = NDArray[np.float64]

CYCLES_AND_SCORE = ((0.0, 0.75), (5.5, 0.6), (7.0, 0.55), (9.0, 0.5))
"""Cycles in a span from which on a best score suffices: one window alone must be clear, in two that agree noise is
as good as never, and the longer it lasts, the fainter it may be."""
MULTIPLE_RATIO = 2.5
"""From which on a longer period at the same time is an odd multiple of the shorter, or a slower swing beneath it."""
STRONGER_RATIO = 1.3
"""Amplitude of a longer one over the shorter one's, from which on it is no multiple: that swings no more."""
AMPLITUDE_SHARE = 0.35
"""Of the error's standard deviation: amplitude from which on a span makes the error what it is (0.06 of its
variance, if it lasts)."""
TIME_SHARE = 0.25
"""Of the judged time in such spans from which on a loop is called oscillating."""
ALTERNATING_ACF, ALTERNATING_SAMPLES = -0.5, 200
"""Autocorrelation after one sample below which what swings is faster than the sampling: differences of white noise
have -0.5; and the fewest samples for it, whose error is then 0.05."""
ALTERNATING_SD = 3.0
"""By so many of its own errors it must lie below, lest differences of noise count in every other record."""
MOST_SPANS = 16
"""Kept of a loop: half of them the newest, half the longest."""
NS = 1_000_000_000


@dataclass(frozen=True, slots=True)
class Episode:
    """A span of a record in which the error oscillates."""

    start: int
    """First sample."""
    end: int
    """One past the last sample."""
    period: float
    """Of the oscillation [s]."""
    amplitude: float
    """Of what swings, as of a sine of the same power [PV]."""
    score: float
    """0.6 to 1: how alike the error is after one and two cycles, and opposite after half a cycle and one and a half."""
    strong: bool
    """Whether it is a good part of what the error does in its record."""


def episodes_of(error: Array, period: float, sp: Array | None = None) -> list[Episode] | None:
    """Return the spans of a record in which the error oscillates; None where five of the fastest cycles do not fit.

    What the error does in time with a set point that moves to and fro is its answer, and no episode: pulses, where
    the loop is good; where it is slow, a swing, which ``sp`` tells by the way that the set point went.

    Parameters
    ----------
    error : ndarray
        (N,) error of samples equally spaced in time, in automatic, without a gap [PV].
    period : float
        Sample period [s].
    sp : ndarray, optional
        (N,) set point [PV].

    Returns
    -------
    list of Episode or None
        In order of time.
    """
    n = len(error)
    if n < WINDOW_CYCLES * FINEST_AVERAGES or not math.isfinite(error.sum()):
        return None
    moves = np.zeros(n) if sp is None else np.asarray(sp, dtype=np.float64) - float(sp[0])
    runs = runs_of(error, moves)
    if not len(runs):
        return []
    sd = float(np.std(error))
    spans = [s for s in _joined(runs) if s[4] >= _least_score((s[1] - s[0]) / s[2])]
    found = [
        Episode(int(a), int(b), p * period, amplitude, score, amplitude >= AMPLITUDE_SHARE * sd)
        for a, b, p, amplitude, score in _without_multiples(spans)
    ]
    return sorted(found, key=lambda one: one.start)


Span = tuple[float, float, float, float, float]
"""Start, end, period [samples], amplitude [PV], score."""


def _joined(runs: Array) -> list[Span]:
    """Put together the runs that are one oscillation."""
    return [_span(runs[runs[:, 6] == group]) for group in np.unique(runs[:, 6])]


def _span(rows: Array) -> Span:
    """Return what joined runs are together: the better a period fits, the more it counts."""
    score = rows[:, 4] / rows[:, 3]
    weight = rows[:, 3] * (score - 0.4) ** 2  # below every score
    weight /= weight.sum()
    period = math.exp(float(weight @ np.log(rows[:, 2] / rows[:, 3])))
    amplitude = float(weight @ (rows[:, 5] / rows[:, 3]))
    return float(rows[:, 0].min()), float(rows[:, 1].max()), float(period), amplitude, float(score.max())


def _least_score(cycles: float) -> float:
    """Return the best score that a span of so many cycles must have."""
    return min(score for least, score in CYCLES_AND_SCORE if cycles >= least)


def _without_multiples(spans: list[Span]) -> list[Span]:
    """Leave out what is but a multiple of a shorter period's swing, for the better half of its time."""
    kept: list[Span] = []
    for one in sorted(spans, key=lambda s: s[2]):
        multiple = any(
            one[2] >= MULTIPLE_RATIO * k[2]
            and one[3] < STRONGER_RATIO * k[3]
            and min(one[1], k[1]) - max(one[0], k[0]) > 0.5 * (one[1] - one[0])
            for k in kept
        )
        if not multiple:
            kept.append(one)
    return kept


@dataclass(frozen=True, slots=True)
class LoopSpan:
    """An episode of a loop, which may go on over several of its blocks."""

    start: int
    """[ns since 1970]"""
    end: int
    """[ns since 1970]"""
    period: float
    """Of the oscillation [s]."""
    amplitude: float
    """[PV]"""
    strong: bool
    """As of an `Episode`: whether it counts."""

    @property
    def duration(self) -> float:
        """From start to end [s]."""
        return (self.end - self.start) / NS


@dataclass(slots=True)
class Episodes:
    """The episodes of a loop, block after block; bounded, however long it is watched.

    Blocks are taken in in order of time. Two of these, of parts of a loop's time, are put together by `merge`.
    """

    judged: float = 0.0
    """Time of all blocks [s]."""
    swinging: float = 0.0
    """Of it, in episodes that count [s]."""
    spans: list[LoopSpan] = field(default_factory=list)
    """The newest and the longest, in order of time."""

    def add(self, found: list[Episode] | None, start: int, n: int, period: float) -> None:
        """Take in a block of ``n`` samples, each of ``period`` [s], the first at ``start`` [ns]; None is not judged."""
        if found is None:
            return
        self.judged += n * period
        self.swinging += period * _covered([(e.start, e.end) for e in found if e.strong])
        for e in found:
            at = (start + round(e.start * period * NS), start + round(e.end * period * NS))
            self._take(LoopSpan(*at, e.period, e.amplitude, e.strong))

    def merge(self, other: Episodes) -> None:
        """Take in what was seen of the same loop at another time."""
        self.judged += other.judged
        self.swinging += other.swinging
        for span in other.spans:
            self._take(span)

    def decay(self) -> None:
        """Halve what is summed over time."""
        self.judged *= 0.5
        self.swinging *= 0.5

    @property
    def oscillating_share(self) -> float | None:
        """Share of the judged time in episodes that count; None before any is."""
        return min(self.swinging / self.judged, 1.0) if self.judged > 0.0 else None

    @property
    def oscillating(self) -> bool | None:
        """Whether that is enough to call the loop oscillating."""
        share = self.oscillating_share
        return None if share is None else share >= TIME_SHARE

    @property
    def period(self) -> float | None:
        """Period of most of the kept spans' swing, by time and power [s]; None without one that counts."""
        strong = [s for s in self.spans if s.strong]
        if not strong:
            return None

        def power(one: LoopSpan) -> float:
            alike = (s for s in strong if _ratio(s.period, one.period) <= SAME_PERIOD_RATIO)
            return sum(s.duration * s.amplitude**2 for s in alike)

        return max(strong, key=power).period

    @property
    def longest(self) -> LoopSpan | None:
        """The longest kept span that counts."""
        return max((s for s in self.spans if s.strong), key=lambda s: s.duration, default=None)

    def _take(self, new: LoopSpan) -> None:
        """Add a span, joined with what it goes on from; let go what is neither new nor long."""
        apart = []
        for old in self.spans:
            gap = (max(old.start, new.start) - min(old.end, new.end)) / NS
            if _ratio(old.period, new.period) <= SAME_PERIOD_RATIO and gap < min(old.period, new.period):
                new = _one_of(old, new)
            else:
                apart.append(old)
        self.spans = sorted([*apart, new], key=lambda s: s.start)
        if len(self.spans) > MOST_SPANS:
            older = self.spans[: -MOST_SPANS // 2]
            self.spans.remove(min(older, key=lambda s: s.duration))


def _one_of(old: LoopSpan, new: LoopSpan) -> LoopSpan:
    """Join two spans; period and amplitude by their times."""
    share = old.duration / max(old.duration + new.duration, 1e-9)
    return LoopSpan(
        min(old.start, new.start),
        max(old.end, new.end),
        old.period**share * new.period ** (1.0 - share),
        math.sqrt(share * old.amplitude**2 + (1.0 - share) * new.amplitude**2),
        old.strong or new.strong,
    )


def _ratio(one: float, other: float) -> float:
    """Return the larger over the smaller."""
    return max(one, other) / min(one, other)


def _covered(spans: list[tuple[int, int]]) -> int:
    """Return how many samples lie in any of some spans."""
    total, until = 0, 0
    for start, end in sorted(spans):
        total += max(end - max(start, until), 0)
        until = max(until, end)
    return total


@jit
def too_fast(error):
    """Whether the error alternates from sample to sample more than differences of noise: under three samples a cycle.

    Parameters
    ----------
    error : ndarray
        (N,) error of samples equally spaced in time [PV].
    """
    n = len(error)
    if n < ALTERNATING_SAMPLES:
        return False
    mean = error.sum() / n
    energy = product = before = 0.0
    for v in error:
        energy += (v - mean) * (v - mean)
        product += (v - mean) * before
        before = v - mean
    return energy > 0.0 and product < (ALTERNATING_ACF - ALTERNATING_SD * 0.7 / math.sqrt(n)) * energy
