"""The compiled part of the search for safe settings: whole regions of models against hundreds of candidates.

The loop gain is written out over one denominator as in `tuners.loops`, and followed along the frequencies once. A
search may be coarse, since what it finds is checked exactly afterwards (`tuners.robustness`).
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from monitor.compiled import jit
from monitor.contract.samples import Array
from tuners.loops import magnitude2, one_of, span

FREQUENCY_STEP_SHARE = 0.08
"""Step of the frequency as a share of it: a parabola through three points finds the peak to 0.1 %."""
TURN_RAD = 0.35
"""Largest step of the dead time's angle [rad]."""
MOST_FREQUENCIES = 2000
"""Steps after which a loop is given up as unsafe."""
LOWEST_LOOP_GAIN = 30.0
"""abs(L) at the lowest frequency: below it abs(S) is under 1/29."""
NEGLIGIBLE_LOOP_GAIN = 0.05
"""abs(L) that is not followed further."""

CROSSOVER_POINTS = 160
"""Frequencies at which a crossover is looked for: 4 to 5 decades at 6 % a step."""


@jit
def _first_frequency(g: float, integrators: int, times: float, lead: float) -> float:
    """Return a frequency from which nothing of the loop is missed [rad/s]; ``times`` and ``lead``: sums [s]."""
    omega = (
        (g / LOWEST_LOOP_GAIN) ** (1.0 / integrators) if integrators > 0 else 0.01 / (times + lead + 1e-300)
    )
    return min(omega, 0.2 / times) if times > 0.0 else omega


@jit
def _turns(model: Array, tf: float, a1: float, a2: float, integrators: int, omega: float) -> float:
    """Whole turns about the origin that the loop gain's angle has made at a frequency [rad/s] where it crosses 1."""
    phase = math.atan2(a1 * omega, 1.0 - a2 * omega * omega) - omega * model[1] - integrators * math.pi / 2
    phase -= math.atan(model[2] * omega) + math.atan(model[3] * omega) + math.atan(tf * omega)
    return float(math.floor((phase + math.pi) / (2.0 * math.pi)))


@jit
def _open_loop(
    model: Array, integrators: int, settings: Array, series: bool
) -> tuple[float, int, float, float, float]:
    """Return g, n, a1, a2, tf of the open loop g (1 + a1 s + a2 s^2) exp(-theta s) / (s^n (tf s + 1) (lags))."""
    ti, td = settings[1], settings[2]
    tf = settings[3] if td > 0.0 else 0.0
    g = model[0] * settings[0]
    lead = td if series else td + tf
    if math.isinf(ti):
        return g, integrators, lead, 0.0, tf
    return g / ti, integrators + 1, ti + (td if series else tf), ti * lead, tf


@jit
def _at_frequency(
    omega: float, model: Array, loop: tuple[float, float, float, float], n: int
) -> tuple[float, float]:
    """Return the open loop (g, a1, a2, tf) with n integrators at a frequency [rad/s]: real and imaginary part."""
    theta, lag, lag2 = model[1], model[2], model[3]
    g, a1, a2, tf = loop
    cos, sin = math.cos(omega * theta), math.sin(omega * theta)
    up_re, up_im = 1.0 - a2 * (omega * omega), a1 * omega
    up_re, up_im = up_re * cos + up_im * sin, up_im * cos - up_re * sin
    down_re, down_im = 1.0, omega * tf
    down_re, down_im = down_re - down_im * omega * lag, down_im + down_re * omega * lag
    down_re, down_im = down_re - down_im * omega * lag2, down_im + down_re * omega * lag2
    for _ in range(n):
        down_re, down_im = -down_im * omega, down_re * omega
    scale = g / (down_re * down_re + down_im * down_im)
    return scale * (up_re * down_re + up_im * down_im), scale * (up_im * down_re - up_re * down_im)


@jit
def least_distance(model: Array, integrators: int, settings: Array, series: bool, enough: float) -> float:
    """Least abs(1 + L), i.e. 1/Ms; 0 where the loop is unstable, anything below ``enough`` as soon as it is below.

    Parameters
    ----------
    model
        (4,): gain, dead time, lag, second lag [s].
    integrators
        Of the process: 1 or 0.
    settings
        (4,): kp, ti, td, tf; ti inf for no integral action.
    series
        Form of the settings; else standard or parallel.
    enough
        Where the answer lies below, it need not be exact.
    """
    theta, lag, lag2 = model[1], model[2], model[3]
    g, n, a1, a2, tf = _open_loop(model, integrators, settings, series)
    times = theta + lag + lag2 + tf
    if not g > 0.0:
        return 0.0
    omega = _first_frequency(g, n, times, a1)
    least, turns = 1.0, 0.0
    size_before, before, before2, omega_before = 0.0, np.inf, np.inf, omega
    for k in range(MOST_FREQUENCIES):
        x = omega * omega
        re, im = _at_frequency(omega, model, (g, a1, a2, tf), n)
        size = re * re + im * im
        distance = (1.0 + re) ** 2 + im * im
        if k > 0 and (size > 1.0) != (size_before > 1.0):
            # stability is decided by the phase at the gain crossovers, as in `tuners.robustness`
            share = math.log(size_before) / (math.log(size_before) - math.log(size))
            at = omega_before * (omega / omega_before) ** share
            turn = _turns(model, tf, a1, a2, n, at)
            turns += turn if size < 1.0 else -turn
        lowest = distance
        bend = before2 - 2.0 * before + distance
        if before <= before2 and before <= distance and 0.0 < bend < np.inf:
            lowest = max(before - (before2 - distance) ** 2 / (8.0 * bend), 0.0)
        least = min(least, math.sqrt(lowest))
        if least < enough:
            return least
        bound = g * (1.0 + a1 * omega + a2 * x) / omega**n
        bound /= max(1.0, omega * lag) * max(1.0, omega * lag2) * max(1.0, omega * tf)
        if bound < max(1.0 - least, NEGLIGIBLE_LOOP_GAIN):
            return least if turns == 0.0 else 0.0
        size_before, before2, before, omega_before = size, before, distance, omega
        step = FREQUENCY_STEP_SHARE * omega
        omega += min(step, TURN_RAD / theta) if theta > 0.0 else step
    return 0.0


@jit
def worst_distance(models: Array, integrators: int, settings: Array, series: bool) -> float:
    """Least abs(1 + L) of one controller over models (M, 4): 1/Ms of the worst, 0 where one is unstable."""
    least = 1.0
    for m in range(len(models)):
        least = min(least, least_distance(models[m], integrators, settings, series, 0.0))
    return least


@jit
def first_safe(
    models: Array, integrators: int, candidates: Array, series: bool, ms_max: float
) -> NDArray[np.int64]:
    """Return for each row of candidates the first that is safe for all models, by bisection; T where none is.

    Parameters
    ----------
    models
        (M, 4): gain, dead time, lag, second lag [s].
    integrators
        Of the process: 1 or 0.
    candidates
        (R, T, 4): kp, ti, td, tf; from fast to slow along T, so that what follows a safe one is safe.
    series
        Form of the settings.
    ms_max
        Highest Ms that is safe.
    """
    rows, count = candidates.shape[0], candidates.shape[1]
    found = np.empty(rows, dtype=np.int64)
    enough, last = 1.0 / ms_max, 0
    for r in range(rows):
        low, high, middle = -1, count, count - 1
        while high - low > 1:
            safe = True
            for m in range(len(models)):
                j = (last + m) % len(models)  # what was dangerous before is asked first
                if least_distance(models[j], integrators, candidates[r, middle], series, enough) < enough:
                    safe, last = False, j
                    break
            if safe:
                high = middle
            elif middle == count - 1:
                break
            else:
                low = middle
            middle = (low + high) // 2
        found[r] = high
    return found


@jit
def last_crossovers(loops):
    """Return the last frequency at which abs(L) = 1, for each of the `Loops` (L,); 0 where there is none [rad/s]."""
    found = np.empty(len(loops.g))
    for k in range(len(found)):
        loop = one_of(loops, k)
        low, high = span(loop)
        first, step = math.log(low), (math.log(high) - math.log(low)) / (CROSSOVER_POINTS - 1)
        found[k], at, size = math.inf, math.log(high), 0.5 * math.log(magnitude2(loop, high))
        for j in range(CROSSOVER_POINTS - 2 if size <= 0.0 else -1, -1, -1):
            was, beyond = size, at
            at = first + j * step
            size = 0.5 * math.log(magnitude2(loop, math.exp(at)))
            if size > 0.0:
                found[k] = math.exp(at + (beyond - at) * size / (size - was))
                break
            found[k] = 0.0
    return found
