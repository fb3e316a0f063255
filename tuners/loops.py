"""The loop gain L(s) of many loops at once: coefficients, magnitude, phase, and the frequencies that matter.

Written out over one denominator, the loop gain of every model and PID form is

    L(s) = g (1 + a1 s + a2 s^2) e^(-theta s) / (s^n (T1 s + 1)(T2 s + 1)...(tf s + 1)),   n = 0, 1 or 2

without poles in the right half plane, so that its magnitude and its *continuous* phase are known in closed
form. Arrays run over loops in their last axis.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from tuners.models import INTEGRATING, Array, Process
from tuners.settings import Settings

LOW_LEVEL = 30.0  # below the frequency where |L| falls to this, |S| is under 1/29: no peak, no crossover
HIGH_LEVEL = 0.1  # above the frequency where |L| falls to this, |S| differs from 1 by 11 % at most
LOG_POINTS = 128  # 4 to 5 decades at 8-10 % a step: neighbouring peaks stay apart, the rest is refinement
BEND = 4.0  # angle of the dead time from which the grid goes on in even steps [rad]


@dataclass(frozen=True, eq=False, slots=True)
class Loops:
    """Coefficients of L(s), arrays (L,); `lags` is (number, L), slowest first, the filter among them."""

    g: Array
    a1: Array
    a2: Array
    dead_time: Array
    lags: Array
    n: Array

    def take(self, index: np.ndarray) -> Loops:
        """Return the loops at `index`."""
        return Loops(
            self.g[index],
            self.a1[index],
            self.a2[index],
            self.dead_time[index],
            self.lags[:, index],
            self.n[index],
        )

    def magnitude2(self, omega: Array) -> Array:
        """Squared abs(L) at omega (..., L) [rad/s]."""
        x = omega * omega
        numerator = 1 + x * (self.a1 * self.a1 - 2 * self.a2 + x * (self.a2 * self.a2))
        if np.any(self.a2 > 0):
            # The expanded form cancels near a lightly damped pair of zeros.
            numerator = (1 - self.a2 * x) ** 2 + self.a1 * self.a1 * x
        poles = np.ones_like(x)
        for lag in self.lags:
            poles = poles * (1 + lag * lag * x)
        power = np.where(self.n == 0, 1.0, np.where(self.n == 1, x, x * x))
        result: Array = self.g * self.g * numerator / (poles * power)
        return result

    def phase(self, omega: Array) -> Array:
        """Continuous phase of L at omega (..., L), with 0 for g > 0 at the origin before the poles [rad]."""
        lead = np.arctan2(self.a1 * omega, 1 - self.a2 * omega * omega)
        sign = np.where(self.g < 0, math.pi, 0.0)
        for lag in self.lags:
            lead = lead - np.arctan(lag * omega)
        result: Array = sign + lead - self.n * (math.pi / 2) - omega * self.dead_time
        return result

    def parts(self, omega: Array) -> tuple[Array, Array]:
        """Real and imaginary part of L at omega (..., L); real arithmetic is twice as fast as complex."""
        angle = omega * self.dead_time
        re, im = np.cos(angle), -np.sin(angle)
        re, im = _times(re, im, 1 - self.a2 * omega * omega, self.a1 * omega)
        for lag in self.lags:
            if np.any(lag > 0):
                x = lag * omega
                re, im = _times(re, im, 1.0, -x)
                scale = 1 / (1 + x * x)
                re, im = re * scale, im * scale
        inverse = 1 / omega
        re, im = _integrate(re, im, inverse, self.n >= 1)
        re, im = _integrate(re, im, inverse, self.n >= 2)
        return self.g * re, self.g * im


def _times(re: Array, im: Array, re2: Array | float, im2: Array) -> tuple[Array, Array]:
    return re * re2 - im * im2, re * im2 + im * re2


def _integrate(re: Array, im: Array, inverse: Array, where: np.ndarray) -> tuple[Array, Array]:
    """Divide by j omega where asked."""
    if not np.any(where):
        return re, im
    if np.all(where):
        return im * inverse, -re * inverse
    return np.where(where, im * inverse, re), np.where(where, -re * inverse, im)


def coefficients(model: Process, settings: Settings) -> tuple[Loops, tuple[int, ...]]:
    """Write model and settings as L(s), with the shape that they broadcast to."""
    tf = settings.filter_time
    fields = (model.gain, model.dead_time, settings.kp, settings.ti, settings.td, tf, *model.lags)
    arrays = np.broadcast_arrays(*fields)
    gain, dead_time, kp, ti, td, tf, *lags = (np.asarray(a, dtype=float).ravel() for a in arrays)
    integral = ~np.isinf(ti)
    safe_ti = np.where(integral, ti, 1.0)
    if settings.form == "series":
        a1, a2 = np.where(integral, safe_ti + td, td), np.where(integral, safe_ti * td, 0.0)
    else:
        a1 = np.where(integral, safe_ti, td) + tf
        a2 = np.where(integral, safe_ti * (tf + td), 0.0)
    n = integral.astype(float) + (model.process == INTEGRATING)
    # Slowest first, as `_reach` wants them; what is 0 in every loop is left out.
    slow = -np.sort(-np.stack([*lags, tf]), axis=0)
    slow = slow[np.any(slow > 0, axis=1) | np.any(np.isnan(slow), axis=1)]
    loops = Loops(gain * kp / safe_ti, a1, a2, dead_time, slow, n)
    return loops, arrays[0].shape


def _reach(c: Array, order: Array, lags: Array) -> Array:
    """Frequency beyond which ``c omega^-order / prod max(1, omega lag)`` stays below 1 [rad/s].

    Any of the lags, taken as pure integrations, bound the term from above; of each number of lags the slowest
    bound it best, and the least bound counts. 0 where the term is below 1 everywhere, inf where it never
    falls below.
    """
    best = np.full(c.shape, np.inf)
    for count in range(len(lags) + 1):
        c = c if count == 0 else c / lags[count - 1]
        total = order + count
        power = c ** (1 / np.maximum(total, 1))
        flat = np.where((total == 0) & (c <= 1), 0.0, np.inf)
        # A lag of 0 leaves c infinite, and so no bound.
        best = np.fmin(best, np.where(total > 0, power, flat))
    return best


def span(loops: Loops) -> tuple[Array, Array]:
    """Lowest and highest frequency worth looking at [rad/s]."""
    g, lags = np.abs(loops.g), loops.lags
    high = high_end(loops, HIGH_LEVEL)
    # |numerator| >= max(1/2, a1 w) while a2 w^2 <= 1/2, and 1 + w lag <= 2 max(1, w lag).
    c = g / (LOW_LEVEL * 2.0 ** (lags > 0).sum(axis=0))
    bounds = _reach(c / 2, loops.n, lags), _reach(c * loops.a1, loops.n - 1, lags)
    slow = np.where(loops.n > 0, np.maximum(*bounds), 0)
    low = np.where((slow > 0) & np.isfinite(slow), slow, 1e-3 / _duration(loops))
    low = np.minimum(low, np.sqrt(0.5 / loops.a2))
    return np.minimum(low, high / 100), high


def high_end(loops: Loops, level: float | Array) -> Array:
    """Frequency beyond which abs(L) stays below `level`, and -180 degrees have been passed [rad/s]."""
    g, lags = np.abs(loops.g), loops.lags
    numerator = (np.ones_like(g), loops.a1, loops.a2)
    # |numerator| <= 1 + a1 w + a2 w^2: with each term below a third of the level, so is their sum.
    high = np.max([_reach(3 * g * a / level, loops.n - i, lags) for i, a in enumerate(numerator)], axis=0)
    # Slow loops peak where the phase is, not where the gain is; 5/theta lies beyond -180 degrees.
    shortest = np.where(lags > 0, lags, np.inf).min(axis=0, initial=np.inf)
    lagging = np.maximum(30 / shortest, 30 / _duration(loops))
    phase = np.where(loops.dead_time > 0, 5 / loops.dead_time, lagging)
    return np.maximum(np.where(np.isfinite(high), high, 20 * phase), phase)


def _duration(loops: Loops) -> Array:
    """Sum of the loop's times, a scale where nothing else gives one [s]."""
    total = loops.dead_time + loops.lags.sum(axis=0) + loops.a1
    return np.where(total > 0, total, 1.0)


def grid(loops: Loops, low: Array, high: Array, linear: int) -> Array:
    """Frequencies (points, L) [rad/s]: geometric up to about one radian of dead time, then even steps."""
    bend = np.minimum(high, BEND / loops.dead_time) if linear else high
    share = np.linspace(0.0, 1.0, LOG_POINTS)[:, np.newaxis]
    logs = np.log(low)
    points = np.exp(logs + share * (np.log(bend) - logs))
    if not linear:
        return np.asarray(points)
    rest = np.arange(1, linear + 1)[:, np.newaxis] / linear
    return np.concatenate([points, bend + rest * (high - bend)])
