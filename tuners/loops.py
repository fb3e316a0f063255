"""The loop gain L(s) of many loops: coefficients, magnitude, phase, and the frequencies that matter; compiled.

Written out over one denominator, the loop gain of every model and PID form is

    L(s) = g (1 + a1 s + a2 s^2) e^(-theta s) / (s^n (T1 s + 1)(T2 s + 1)...(tf s + 1)),   n = 0, 1 or 2

without poles in the right half plane, so that its magnitude and its *continuous* phase are known in closed
form. Types are inferred by numba.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from tuners.compiled import jit
from tuners.models import INTEGRATING, Array, Process
from tuners.settings import Settings

LOW_LEVEL = 30.0  # below the frequency where |L| falls to this, |S| is under 1/29: no peak, no crossover
HIGH_LEVEL = 0.1  # above the frequency where |L| falls to this, |S| differs from 1 by 11 % at most
LOG_POINTS = 128  # 4 to 5 decades at 8-10 % a step: neighbouring peaks stay apart, the rest is refinement
BEND = 4.0  # angle of the dead time from which the grid goes on in even steps [rad]


class Loops(NamedTuple):
    """Coefficients of L(s) of many loops, arrays (L,)."""

    g: Array
    a1: Array
    a2: Array
    dead_time: Array
    lags: Array
    """(L, number) slowest first, the filter among them; 0 where a loop has fewer [s]."""
    n: Array


class Loop(NamedTuple):
    """Those of one loop."""

    g: float
    a1: float
    a2: float
    dead_time: float
    lags: Array
    """(number,)"""
    n: float


def coefficients(model: Process, settings: Settings) -> tuple[Loops, tuple[int, ...]]:
    """Write model and settings as L(s), with the shape that they broadcast to."""
    rows, shape = numbers(model, settings)
    loops: Loops = _written(rows, settings.form == "series", float(model.process == INTEGRATING))
    return loops, shape


def numbers(model: Process, settings: Settings) -> tuple[Array, tuple[int, ...]]:
    """Return gain, dead time, kp, ti, td, tf and lags, rows (k, L), and the shape to which they broadcast."""
    times = model.dead_time, settings.kp, settings.ti, settings.td, settings.filter_time, *model.lags
    fields = (model.gain, *times)
    shape = np.broadcast(*fields).shape
    rows = np.empty((len(fields), *shape))
    for k, field in enumerate(fields):
        rows[k] = field
    return rows.reshape(len(fields), -1), shape


@jit
def numerator(ti, td, tf, b, c, series):
    """Return n0, n1, n2 of a controller's path ``kp (n0 + n1 s + n2 s^2)/(tf s + 1)``, over ``ti s`` with an integral.

    Of the set point's path with its weights; with both of them 1 of the feedback.
    """
    lead = tf + c * (td - tf) if series else b * tf + c * td
    if math.isinf(ti):
        return b, (b * lead if series else lead), 0.0
    return 1.0, b * ti + (lead if series else tf), ti * (b * lead if series else lead)


@jit
def _written(rows, series, integrators):
    """Return the coefficients of loops whose gain, dead time, kp, ti, td, tf and lags are the rows (k, L)."""
    count, number = rows.shape[1], len(rows) - 5
    g, a1, a2, n = np.empty(count), np.empty(count), np.empty(count), np.empty(count)
    lags = np.zeros((count, number))
    for k in range(count):
        ti, td, tf = rows[3, k], rows[4, k], rows[5, k]
        _, a1[k], a2[k] = numerator(ti, td, tf, 1.0, 1.0, series)
        g[k], n[k] = rows[0, k] * rows[2, k], integrators
        if not math.isinf(ti):
            g[k], n[k] = g[k] / ti, integrators + 1.0
        for j in range(number):
            lag = rows[5 + j, k]
            i = j
            while i > 0 and not lags[k, i - 1] >= lag:
                lags[k, i] = lags[k, i - 1]
                i -= 1
            lags[k, i] = lag
    return Loops(g, a1, a2, rows[1].copy(), lags, n)


@jit
def one_of(loops, k):
    """Return the k-th of some loops."""
    return Loop(loops.g[k], loops.a1[k], loops.a2[k], loops.dead_time[k], loops.lags[k], loops.n[k])


@jit
def magnitude2(loop, omega):
    """Squared abs(L) at a frequency [rad/s]."""
    x = omega * omega
    # the expanded form cancels near a lightly damped pair of zeros
    numerator = (1.0 - loop.a2 * x) ** 2 + loop.a1 * loop.a1 * x
    poles = 1.0
    for lag in loop.lags:
        poles *= 1.0 + lag * lag * x
    power = 1.0 if loop.n == 0 else x if loop.n == 1 else x * x
    return loop.g * loop.g * numerator / (poles * power)


@jit
def phase(loop, omega):
    """Continuous phase of L at a frequency [rad/s], with 0 for g > 0 at the origin before the poles [rad]."""
    lead = math.atan2(loop.a1 * omega, 1.0 - loop.a2 * omega * omega)
    for lag in loop.lags:
        lead -= math.atan(lag * omega)
    sign = math.pi if loop.g < 0 else 0.0
    return sign + lead - loop.n * (math.pi / 2) - omega * loop.dead_time


@jit
def parts(loop, omega):
    """Real and imaginary part of L at a frequency [rad/s]."""
    angle = omega * loop.dead_time
    cos, sin = math.cos(angle), -math.sin(angle)
    up, across = 1.0 - loop.a2 * omega * omega, loop.a1 * omega
    re, im = cos * up - sin * across, cos * across + sin * up
    for lag in loop.lags:
        if lag > 0.0:
            x = lag * omega
            scale = 1.0 / (1.0 + x * x)
            re, im = (re + im * x) * scale, (im - re * x) * scale
    inverse = 1.0 / omega
    for _ in range(loop.n):
        re, im = im * inverse, -re * inverse
    return loop.g * re, loop.g * im


@jit
def _reach(c, order, lags):
    """Frequency beyond which ``c omega^-order / prod max(1, omega lag)`` stays below 1 [rad/s].

    Any of the lags, taken as pure integrations, bound the term from above; of each number of lags the slowest
    bound it best, and the least bound counts. 0 where the term is below 1 everywhere, inf where it never
    falls below.
    """
    best = math.inf
    for count in range(len(lags) + 1):
        if count > 0:
            if not lags[count - 1] > 0.0:
                break
            c /= lags[count - 1]
        total = order + count
        if total > 0:
            best = min(best, c ** (1.0 / total))
        elif total == 0 and c <= 1.0:
            best = 0.0
    return best


@jit
def _duration(loop):
    """Sum of the loop's times, a scale where nothing else gives one [s]."""
    total = loop.dead_time + loop.a1
    for lag in loop.lags:
        total += lag
    return total if total > 0.0 else 1.0


@jit
def span(loop):
    """Lowest and highest frequency worth looking at [rad/s]."""
    high = high_end(loop, HIGH_LEVEL)
    # |numerator| >= max(1/2, a1 w) while a2 w^2 <= 1/2, and 1 + w lag <= 2 max(1, w lag).
    c, slow = abs(loop.g) / LOW_LEVEL, 0.0
    for lag in loop.lags:
        c *= 0.5 if lag > 0.0 else 1.0
    if loop.n > 0:
        slow = max(_reach(0.5 * c, loop.n, loop.lags), _reach(c * loop.a1, loop.n - 1.0, loop.lags))
    low = slow if 0.0 < slow < math.inf else 1e-3 / _duration(loop)
    low = min(low, math.sqrt(0.5 / loop.a2))
    return min(low, high / 100.0), high


@jit
def high_end(loop, level):
    """Frequency beyond which abs(L) stays below ``level``, and -180 degrees have been passed [rad/s]."""
    # |numerator| <= 1 + a1 w + a2 w^2: with each term below a third of the level, so is their sum.
    c = 3.0 * abs(loop.g) / level
    high = max(
        _reach(c, loop.n, loop.lags),
        _reach(c * loop.a1, loop.n - 1.0, loop.lags),
        _reach(c * loop.a2, loop.n - 2.0, loop.lags),
    )
    # Slow loops peak where the phase is, not where the gain is; 5/theta lies beyond -180 degrees.
    shortest = math.inf
    for lag in loop.lags:
        if lag > 0.0:
            shortest = lag
    turned = max(30.0 / shortest, 30.0 / _duration(loop))
    if loop.dead_time > 0.0:
        turned = 5.0 / loop.dead_time
    return max(high if high < math.inf else 20.0 * turned, turned)


@jit
def geometric(low, high, k):
    """Return the k-th of `LOG_POINTS` frequencies from one to another, each as many times the one before [rad/s]."""
    share = k * (1.0 / (LOG_POINTS - 1)) if k < LOG_POINTS - 1 else 1.0
    return math.exp(math.log(low) + share * (math.log(high) - math.log(low)))


@jit
def grid(loop, low, high, linear):
    """Frequencies (points,) [rad/s]: geometric up to about one radian of dead time, then even steps."""
    bend = min(high, BEND / loop.dead_time) if linear > 0 else high
    out = np.empty(LOG_POINTS + linear)
    for k in range(LOG_POINTS):
        out[k] = geometric(low, bend, k)
    for k in range(linear):
        out[LOG_POINTS + k] = bend + (k + 1) / linear * (high - bend)
    return out
