"""The compiled part of step responses: how long they last, and from the frequency response to their figures.

Types are inferred by numba.
"""

from __future__ import annotations

import math

import numpy as np

from tuners.compiled import jit
from tuners.loops import coefficients, magnitude2, numbers, numerator, one_of, parts
from tuners.models import INTEGRATING, Array, Process
from tuners.settings import Settings

SWEEP = np.geomspace(1.0, 1e6, 200)  # where a crossover is looked for, in windows
WINDOW_TIME_CONSTANTS = 12.0  # slowest ones in the first window: e^-12 is below `SETTLED_SHARE`, with room
SETTLED_SHARE = 1e-4  # share of the step that may be left at the end of the window; above, the window doubles
OVERSHOOT, IAE_SETPOINT, IAE_LOAD, SETTLED = range(4)  # rows of what is found


def first_window(model: Process, settings: Settings) -> Array:
    """Twelve times the slowest time constant of the loop with its dead time as a first-order Padé (L,) [s]."""
    rows, _ = numbers(model, settings)
    companions, unit, shortest = _companions(rows, settings.form == "series", model.process == INTEGRATING)
    times = np.linalg.eigvals(companions)
    with np.errstate(divide="ignore", invalid="ignore"):
        slowest = np.nanmax(
            np.where(np.abs(times) > 1e-9, np.abs(times) ** 2 / np.abs(times.real), 0.0), axis=1
        )
    window = np.maximum(shortest, WINDOW_TIME_CONSTANTS * np.where(np.isfinite(slowest), slowest, 0.0))
    return np.asarray(np.where(window > 0, window, 1.0) * unit)


@jit
def _companions(rows, series, integrating):
    """Return companion matrices (L, n, n), the unit of their times (L,) [s] and the shortest window (L,) in it.

    ``rows`` as in `numbers`. The polynomial is reversed, so that the times 1/s are its roots: one of nothing does no
    harm there.
    """
    count, number = rows.shape[1], len(rows) - 6
    size = 3 + number + (1 if integrating else 0)
    out = np.zeros((count, size, size))
    units, shortest = np.empty(count), np.empty(count)
    for k in range(count):
        gain, dead_time, kp = rows[0, k], rows[1, k], rows[2, k]
        ti, td, tf = rows[3, k], rows[4, k], rows[5, k]
        unit, lags = dead_time + td, 0.0
        for lag in rows[6:, k]:
            lags += lag
        unit += lags
        integral = 0.0 if math.isinf(ti) else 1.0
        if not unit > 0.0:
            unit = ti if integral > 0.0 else 1.0
        half, td, tf = 0.5 * dead_time / unit, td / unit, tf / unit
        reset = unit / ti if integral > 0.0 else 1.0
        # polynomials in s, ascending; a factor 1 stands in for the integral action that is not there
        with_td = td if series else tf
        lead = (reset, integral + reset * with_td, integral * with_td)
        if not series:
            lead = (
                lead[0],
                lead[1] + (td if integral == 0.0 else 0.0),
                lead[2] + (td if integral > 0.0 else 0.0),
            )
        poles = np.zeros(size + 1)
        poles[0], poles[1], poles[2] = 1.0 - integral, integral + (1.0 - integral) * tf, integral * tf
        for lag in rows[6:, k]:
            _times(poles, 1.0, lag / unit)
        if integrating:
            _times(poles, 0.0, 1.0)
            gain *= unit
        _times(poles, 1.0, half)
        feedback = np.zeros(4)
        feedback[0], feedback[1], feedback[2] = lead
        _times(feedback, 1.0, -half)
        for j in range(4):
            poles[j] += gain * kp * feedback[j]
        for j in range(size):
            out[k, 0, j] = -poles[j + 1] / poles[0]
            if j > 0:
                out[k, j, j - 1] = 1.0
        units[k], shortest[k] = unit, 20.0 * (2.0 * half + lags / unit) + 10.0 * td
    return out, units, shortest


@jit
def _times(polynomial, a, b):
    """Multiply a polynomial, ascending coefficients, by ``a + b s``, in place."""
    for j in range(len(polynomial) - 1, 0, -1):
        polynomial[j] = polynomial[j] * a + polynomial[j - 1] * b
    polynomial[0] *= a


def points(model: Process, settings: Settings, window: Array, step: float, least: int, most: int) -> int:
    """Odd harmonics that all windows need: ``1/step`` samples a radian of the highest crossover, as the cap allows.

    Parameters
    ----------
    window
        Of each loop (L,) [s].
    """
    fastest = _speeds(coefficients(model, settings)[0], window)
    if np.all(np.asarray(model.t0) > 0):
        fastest = np.maximum(fastest, 2 / np.min(model.t0))
    wanted = np.max(window * fastest) / step
    return int(min(max(2.0 ** math.ceil(math.log2(max(wanted, 1.0))), least), most))


@jit
def _speeds(loops, window):
    """Highest frequency at which abs(L) is above 1, within the reach of each window; (L,) [rad/s]."""
    out = 1.0 / window
    for k in range(len(out)):
        loop = one_of(loops, k)
        for j in range(len(SWEEP) - 1, -1, -1):
            omega = SWEEP[j] / window[k]
            if magnitude2(loop, omega) > 1.0:
                out[k] = max(out[k], omega)
                break
    return out


@jit
def spectra(process, controllers, series, window, count):
    """Return the odd harmonics (2, L, count) of PV in answer to square waves of set point and load.

    Parameters
    ----------
    process
        `Loops` of one loop without a controller.
    controllers
        (6, L): kp, ti, td, tf, b, c.
    window
        Half periods (L,) [s].
    """
    out = np.empty((2, len(window), count), dtype=np.complex128)
    alone = one_of(process, 0)
    for k in range(len(window)):
        kp, ti, td = controllers[0, k], controllers[1, k], controllers[2, k]
        tf, b, c = controllers[3, k], controllers[4, k], controllers[5, k]
        n0, n1, n2 = numerator(ti, td, tf, 1.0, 1.0, series)
        f0, f1, f2 = numerator(ti, td, tf, b, c, series)
        integral = not math.isinf(ti)
        for m in range(count):
            omega = (2 * m + 1) * (math.pi / window[k])
            re, im = parts(alone, omega)
            plant = complex(re, im)
            rest = (
                kp / (complex(0.0, omega * ti) * complex(1.0, omega * tf))
                if integral
                else kp / complex(1.0, omega * tf)
            )
            closed = plant / (1.0 + plant * (rest * complex(n0 - n2 * omega * omega, n1 * omega)))
            harmonic = complex(0.0, math.pi * (2 * m + 1))
            out[0, k, m] = closed * (rest * complex(f0 - f2 * omega * omega, f1 * omega)) / harmonic
            out[1, k, m] = closed / harmonic
    return out


@jit
def figures_of(waves, turn, window, final, dead_time):
    """Return overshoot, IAE after set-point and load step, and whether all has settled within the window; (4, L).

    Parameters
    ----------
    waves
        (2, L, count) transforms of `spectra`.
    turn
        (count,) half a turn in so many steps.
    window
        (L,) [s].
    final
        (2, L) PV that the loops settle at [PV].
    """
    loops, count = waves.shape[1], waves.shape[2]
    out = np.empty((4, loops))
    for k in range(loops):
        out[SETTLED, k] = 1.0
        for kind in range(2):
            target, end = 1.0 - kind, final[kind, k]
            total = largest = last = 0.0
            sign = 1.0 if end > 0.0 else -1.0 if end < 0.0 else 0.0
            beyond = -math.inf
            for m in range(count):
                pv = 0.0
                if m / count * window[k] > dead_time:  # causality, where the cut series rings a little
                    pv = 2.0 * count * (waves[kind, k, m] * turn[m]).real + end / 2.0
                total += abs(target - pv) * (0.5 if m == 0 else 1.0)
                largest, beyond = max(largest, abs(pv)), max(beyond, sign * pv)
                if count - -(-count // 10) <= m < count - -(-count // 50):
                    last = max(last, abs(pv - end))
            if not last < SETTLED_SHARE * max(target, largest):
                out[SETTLED, k] = 0.0
            out[IAE_SETPOINT + kind, k] = math.inf if abs(target - end) > 1e-9 else total * window[k] / count
            if kind == 0:
                out[OVERSHOOT, k] = max(beyond - abs(end), 0.0) / (1.0 if end == 0.0 else abs(end))
    return out
