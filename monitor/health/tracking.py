"""How PV follows the moves of its set point: the closed loop's shape, seen even where its dead time is not.

A good loop answers a set point as a short delay and one lag would (D. E. Rivera, M. Morari, S. Skogestad, Ind. Eng.
Chem. Process Des. Dev. 25 (1986) 252-265: what internal model control aims at). Fitted are the two, over all moves of
a record; judged is each move, by what the fit leaves, by what goes beyond the set point, and by what stays of it.
The limits are our own.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from monitor.compiled import jit

Array = NDArray[np.float64]

STEP_SD = 4.0
"""Of PV's noise: least step of the set point that PV can be seen to follow."""
STEPPING_SHARE = 0.05
"""Of the samples that step, above which somebody else moves the set point: a slave, or a ramp."""
DELAYS = 17
"""Tried: 0 to 16 samples."""
LAGS = 0.3 * (80.0 / 0.3) ** (np.arange(24) / 23.0)
"""Tried [samples]: by a factor of 1.27, from what cannot be told from none."""
SETTLED_LAGS, SETTLED_SAMPLES = 3.0, 6
"""Delay and lag after which a move is over: 5 % are left, and what the grid misses; and samples more."""
BEFORE_SAMPLES = 10
"""Before a move, from which its window begins: they tell where PV was."""
AFTER_SETTLED = 3.0
"""End of a move's window, in times in which it is over: what comes later is of loads."""
FIRST_LOOK_SAMPLES = 40
"""After each step, over which delay and lag are first fitted."""
CLEAR_SD = 9.0
"""Least size of a move over the noise that can be judged: a tenth of it is then one deviation."""
LATE_SAMPLES = 5
"""After a move is over, without which nothing is said of what stays."""
LEAST_FIT = 0.95
"""Share of PV's movement, noise left out, that delay and lag explain."""
QUICK_SAMPLES = 15.0
"""Delay and lag together, up to which a loop is called quick for its sampling; slower ones are assessed as events."""
SMOOTHED_SAMPLES = 3
"""In the mean that overshoot is read from."""
OVERSHOOT_SD = 1.5
"""Of PV's noise, that does not count as overshoot: the highest of some fifty such means."""
OVERSHOOT_SHARE, RINGING_SHARE, LATE_SHARE = 0.15, 0.4, 0.1
"""Of the move: more overshoot than the first is no tracking, than the second is ringing (a well tuned PI on an
integrating process overshoots by 20 to 30 %); more than the last left at its end is crawling."""
SURE_SD = 25.0
"""Size of a single move over the noise, at which it need not be confirmed by a second."""

MOST_SHARE = 0.75
"""Of the moves that can be judged, that must say the same: one in four may meet a load."""

Verdict = Literal["tracks", "rings", "crawls"]


@dataclass(frozen=True, slots=True)
class Tracked:
    """A move of the set point, in one step or in several that follow closely, and how PV followed."""

    start: int
    """Sample of the first step."""
    size: float
    """From before the first step to after the last, signed [PV]."""
    delay: float
    """Of all moves of the record [s]."""
    lag: float
    """[s]"""
    fit: float
    """Share of PV's movement over the window, noise left out, that follows delay and lag."""
    overshoot: float
    """Beyond the set point, over the size."""
    late: float | None
    """What stays of the move after it should be over, over its size; None where the window ends before."""
    clear: float
    """Size over PV's noise."""
    verdict: Verdict | None
    """None where the move is too small, too short, or nothing of the three."""


def tracking_of(sp: Array, pv: Array, period: float, noise: float) -> list[Tracked]:
    """Return the moves of a set point, and how PV followed each; none where the set point moves all the time.

    Parameters
    ----------
    sp, pv : ndarray
        (N,) samples equally spaced in time, in automatic, without a gap [PV].
    period : float
        Sample period [s].
    noise : float
        Standard deviation of PV's noise from sample to sample [PV].

    Returns
    -------
    list of Tracked
        In order of time.
    """
    if len(pv) < 2 * BEFORE_SAMPLES or not (np.isfinite(sp).all() and np.isfinite(pv).all()):
        return []
    least = max(STEP_SD * noise, 1e-9 * float(np.max(np.abs(sp))))
    steps = np.flatnonzero(np.abs(np.diff(sp)) > least) + 1
    if not len(steps) or len(steps) > STEPPING_SHARE * len(sp):
        return []
    ends = np.minimum(steps + FIRST_LOOK_SAMPLES, len(sp))
    delay, lag = _fitted(sp, pv, _around(len(sp), steps, ends))
    settled = SETTLED_LAGS * (delay + lag) + SETTLED_SAMPLES
    ends = np.minimum(steps + int(AFTER_SETTLED * settled), len(sp))
    delay, lag = _fitted(sp, pv, _around(len(sp), steps, ends))
    model = _answer(sp, delay, lag)
    settled = SETTLED_LAGS * (delay + lag) + SETTLED_SAMPLES
    breaks = np.flatnonzero(np.diff(steps) >= settled) + 1
    groups = np.split(steps, breaks)
    begins = [int(g[0]) for g in groups]
    found = []
    for group, following in zip(groups, [*begins[1:], len(sp)], strict=True):
        end = min(following, int(group[-1] + AFTER_SETTLED * settled))
        seen = _Move(sp, pv, model, group, end, noise)
        found.append(seen.judged(delay, lag, period))
    return found


def tracking_verdict(moves: list[Tracked]) -> Verdict | None:
    """Return what a record's moves say together: the same of all that say anything, by two or by one that is clear.

    Parameters
    ----------
    moves : list of Tracked
        Of one record, or of several.
    """
    # a move that is large enough, and over, and yet nothing of the three, has met a load, or speaks against all
    said = [m for m in moves if m.clear >= CLEAR_SD and m.late is not None]
    if not said:
        return None
    most, n = Counter(m.verdict for m in said).most_common(1)[0]
    if most is None or n < MOST_SHARE * len(said):
        return None
    return most if n > 1 or said[0].clear >= SURE_SD else None


class _Move:
    """One move's window."""

    def __init__(
        self, sp: Array, pv: Array, model: Array, steps: NDArray[np.int64], end: int, noise: float
    ) -> None:
        first, self.last, self.end = int(steps[0]), int(steps[-1]), end
        self.first, self.noise = first, noise
        self.pv, self.sp = pv, sp
        begin = max(first - BEFORE_SAMPLES, 0)
        self.part = slice(begin, end)
        self.model = model
        self.size = float(sp[self.last] - sp[first - 1])
        self.extent = max(abs(self.size), 1e-300)

    def judged(self, delay: int, lag: float, period: float) -> Tracked:
        """Return the move with its verdict."""
        settled = int(SETTLED_LAGS * (delay + lag) + SETTLED_SAMPLES)
        fit, over, late = self._fit(), self._overshoot(), self._late(settled)
        clear = abs(self.size) / max(self.noise, 1e-9 * abs(self.size), 1e-300)
        verdict: Verdict | None = None
        if clear < CLEAR_SD or late is None:
            verdict = None
        elif over > RINGING_SHARE:
            verdict = "rings"
        elif over > OVERSHOOT_SHARE:
            verdict = None
        elif late > LATE_SHARE:
            verdict = "crawls"
        elif fit >= LEAST_FIT and late >= -LATE_SHARE and delay + lag <= QUICK_SAMPLES:
            verdict = "tracks"
        return Tracked(
            self.first, self.size, delay * period, lag * period, fit, over, late, min(clear, 1e9), verdict
        )

    def _fit(self) -> float:
        pv, rest = self.pv[self.part], self.pv[self.part] - self.model[self.part]
        own = self.noise**2
        total = max(float(np.var(pv)) - own, 1e-12 * self.extent**2)
        return max(1.0 - max(float(np.var(rest)) - own, 0.0) / total, 0.0)

    def _overshoot(self) -> float:
        after = self.pv[self.last : self.end]
        if len(after) < SMOOTHED_SAMPLES:
            return 0.0
        smooth = np.convolve(after, np.full(SMOOTHED_SAMPLES, 1.0 / SMOOTHED_SAMPLES), "valid")
        beyond = float(np.max(np.sign(self.size) * (smooth - self.sp[self.last])))
        return max(beyond - OVERSHOOT_SD * self.noise, 0.0) / self.extent

    def _late(self, settled: int) -> float | None:
        part = slice(self.last + settled, self.end)
        if part.stop - part.start < LATE_SAMPLES:
            return None
        return float(np.mean(self.sp[part] - self.pv[part])) * float(np.sign(self.size)) / self.extent


def _around(n: int, steps: NDArray[np.int64], ends: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Mark the samples around steps."""
    use = np.zeros(n, dtype=np.bool_)
    for first, end in zip(steps, ends, strict=True):
        use[max(first - BEFORE_SAMPLES, 0) : end] = True
    return use


def _fitted(sp: Array, pv: Array, use: NDArray[np.bool_]) -> tuple[int, float]:
    """Return the delay and the lag that leave least of PV [samples], a constant aside."""
    left = np.empty((len(LAGS), DELAYS))
    at = np.flatnonzero(use)
    rest = np.ascontiguousarray(pv, dtype=np.float64)
    for k, lag in enumerate(LAGS):
        _residuals(_answer(sp, 0, float(lag)), rest, at, left[k])
    best = int(np.argmin(left))
    return best % DELAYS, float(LAGS[best // DELAYS])


def _answer(sp: Array, delay: int, lag: float) -> Array:
    """Return a set point through a delay and a lag [samples]."""
    out = np.empty(len(sp))
    _lagged(np.ascontiguousarray(sp, dtype=np.float64), float(np.exp(-1.0 / lag)), out)
    return np.concatenate([np.full(delay, out[0]), out[: len(out) - delay]])


@jit
def _lagged(x, keep, out):
    """Write a signal through a lag that keeps a share of what it was; a sample answers the one before."""
    y = x[0]
    for i in range(len(x)):
        out[i] = y
        y = keep * y + (1.0 - keep) * x[i]


@jit
def _residuals(model, pv, at, out):
    """Write the variance that a model leaves of PV at some samples, for each delay."""
    for delay in range(len(out)):
        total = square = 0.0
        for k in range(len(at)):
            r = pv[at[k]] - model[max(at[k] - delay, 0)]
            total += r
            square += r * r
        out[delay] = square - total * total / len(at)
