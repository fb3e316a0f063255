"""How safe a loop is: peak sensitivity Ms, margins and stability, with exact dead time, for many loops.

Stability needs no fine Nyquist curve: it is decided by the phase at the gain crossovers (see `_crossings`).
The search is compiled; types are inferred by numba.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from tuners.compiled import jit
from tuners.loops import (
    BEND,
    HIGH_LEVEL,
    LOG_POINTS,
    coefficients,
    geometric,
    grid,
    high_end,
    magnitude2,
    one_of,
    parts,
    phase,
    span,
)
from tuners.models import Array, FloatOrArray, Process
from tuners.settings import Settings

PHASE_STEP = 0.35  # dead time turns the curve by omega theta: no step beyond this angle [rad]
LINEAR_SIZES = (0, 32, 64, 128, 256, 512, 1024, 4096)  # points of the linear part
MS_ACCURACY = 1e-3  # of Ms: abs(L) below this is of no account
MS, MT, GAIN, PHASE, DELAY, STABLE = range(6)  # columns of what is found


@dataclass(frozen=True, slots=True)
class Margins:
    """Robustness of a loop; each field a float or an array over loops.

    Parameters
    ----------
    ms, mt
        Peaks of abs(S) and abs(T); inf where unstable [-].
    gain_margin
        Factor on the gain up to instability; inf where the phase never gets there, NaN where unstable [-].
    phase_margin
        Smallest phase margin over all gain crossovers; inf without crossover, NaN where unstable [degrees].
    delay_margin
        Extra dead time up to instability; inf without gain crossover, NaN where unstable [s].
    stable
        Whether the closed loop is asymptotically stable.
    """

    ms: FloatOrArray
    mt: FloatOrArray
    gain_margin: FloatOrArray
    phase_margin: FloatOrArray
    delay_margin: FloatOrArray
    stable: bool | np.ndarray


@jit
def _distance2(loop, omega, of):
    """Squared abs(1 + L), or abs(1 + 1/L) where it is that ``of`` MT, at a frequency [rad/s]."""
    re, im = parts(loop, omega)
    d2 = (1.0 + re) ** 2 + im * im
    return d2 / (re * re + im * im) if of == MT else d2


@jit
def _least_distance(loop, omega, of):
    """Least abs(1 + L) over the grid, refined, or abs(1 + 1/L) where it is that ``of`` MT."""
    count = len(omega)
    squared, least = np.empty(count), math.inf
    for k in range(count):
        squared[k] = _distance2(loop, omega[k], of)
        least = min(least, squared[k])
    best = math.sqrt(least)
    # Two peaks can be equally high within the grid's error: refine the two lowest local minima.
    first = second = 0
    for k in range(1, count - 1):
        if squared[k] <= squared[k - 1] and squared[k] <= squared[k + 1]:
            if first == 0 or squared[k] < squared[first]:
                first, second = k, first
            elif second == 0 or squared[k] < squared[second]:
                second = k
    for k in (first, second):
        if k > 0:
            low, high = math.log(omega[k - 1]), math.log(omega[k + 1])
            best = min(best, _refine(loop, low, high, of))
    return best


@jit
def _refine(loop, low, high, of):
    """Least distance between two log frequencies: two rounds of nine points, then a parabola."""
    squared, index = np.empty(9), 0
    for _ in range(2):
        index = 0
        for k in range(9):
            squared[k] = _distance2(loop, math.exp(low + k / 8 * (high - low)), of)
            index = k if squared[k] < squared[index] else index
        lowest = squared[index]
        index = min(max(index, 1), 7)
        step = (high - low) / 8
        low, high = low + (index - 1) * step, low + (index + 1) * step
    left, middle, right = squared[index - 1], squared[index], squared[index + 1]
    bend, slope = left - 2.0 * middle + right, left - right
    drop = slope * slope / (8.0 * bend) if bend > 0.0 else 0.0
    # The parabola may dip below 0 where the curve runs through -1: there the nearest point counts.
    return math.sqrt(min(middle - drop, lowest) if middle - drop > 0.0 else lowest)


@jit
def _crossing(loop, low, high, falling):
    """Frequency between two where abs(L) = 1 [rad/s]; ``falling``: from above."""
    low, high = math.log(low), math.log(high)
    f_low, f_high = math.log(magnitude2(loop, math.exp(low))), math.log(magnitude2(loop, math.exp(high)))
    was_low = was_high = False
    middle = low
    for _ in range(60):  # Illinois variant of the false position: keeps the bracket, converges fast
        middle = (low * f_high - high * f_low) / (f_high - f_low)
        f = math.log(magnitude2(loop, math.exp(middle)))
        if abs(f) < 1e-11:
            break
        if (f > 0.0) == falling:  # the crossing lies above: the lower end moves
            low, f_low, f_high = middle, f, f_high / 2 if was_low else f_high
            was_low, was_high = True, False
        else:
            high, f_low, f_high = middle, f_low / 2 if was_high else f_low, f
            was_low, was_high = False, True
    return math.exp(middle)


@jit
def _crossings(loop, omega):
    """Count the turns at the gain crossovers, and find the least phase margin [degrees] and delay margin [s] over them.

    The Nyquist count from the phase there: L has no poles in the right half plane, so the loop is stable if
    arg(1 + L) turns by n pi/2 from omega = 0+ to infinity, which makes it end at 0. While abs(L) > 1, arg(1 + L)
    stays within pi/2 of the phase of L; while abs(L) < 1, within pi/2 of the multiple of 2 pi to which it has
    fallen. So the turns at falling crossovers less those at rising ones must vanish.
    """
    turns, least_phase, least_delay = 0.0, math.inf, math.inf
    above = magnitude2(loop, omega[0]) > 1.0
    for k in range(1, len(omega)):
        was, above = above, magnitude2(loop, omega[k]) > 1.0
        if was == above:
            continue
        at = _crossing(loop, omega[k - 1], omega[k], was)
        angle = phase(loop, at) + math.pi
        whole = math.floor(angle / (2.0 * math.pi))
        turns += whole if was else -whole
        rest = angle - 2.0 * math.pi * whole
        least_phase = min(least_phase, math.degrees(min(rest, 2.0 * math.pi - rest)))
        least_delay = min(least_delay, rest / at)
    return turns, least_phase, least_delay


@jit
def _final_gain(loop):
    """Return abs(L) at infinite frequency: 0 unless nothing rolls the loop off; inf for improper loops."""
    power = (2.0 if loop.a2 > 0.0 else 1.0 if loop.a1 > 0.0 else 0.0) - loop.n
    flat = abs(loop.g) * (loop.a2 if loop.a2 > 0.0 else loop.a1 if loop.a1 > 0.0 else 1.0)
    for lag in loop.lags:
        if lag > 0.0:
            power, flat = power - 1.0, flat / lag
    return math.inf if power > 0.0 else flat if power == 0.0 else 0.0


@jit
def _linear_points(loop, high):
    """Return the points of the grid's linear part that the loop's dead time asks for."""
    angle = high * loop.dead_time - BEND
    needed = angle / PHASE_STEP if angle > 3.0 else 0.0
    for size in LINEAR_SIZES:
        if size >= needed:
            return size
    return LINEAR_SIZES[-1]


@jit
def _needed(loop, low, high, full):
    """Highest frequency [rad/s] that can matter for Ms, after a first look below one turn of the dead time.

    What has been seen there is a lower bound of Ms: beyond the frequency where abs(L) falls below 1 - 1/Ms
    nothing can surpass it.
    """
    if not high * loop.dead_time > BEND + 3.0:
        return high
    seen = math.inf
    for k in range(0, LOG_POINTS, 2):
        re, im = parts(loop, geometric(low, BEND / loop.dead_time, k))
        seen = min(seen, (1.0 + re) ** 2 + im * im)
    # The margins are exact down to the same level of abs(L) as everywhere.
    level = min(max(1.0 - math.sqrt(seen), MS_ACCURACY), HIGH_LEVEL if full else 0.9)
    # The bound is generous; abs(L) itself, which is smooth out there, says how far it really is.
    first, end = 5.0 / loop.dead_time, high_end(loop, level)
    k = LOG_POINTS - 4
    while k > 0 and not magnitude2(loop, geometric(first, end, k)) > (0.9 * level) ** 2:
        k -= 4
    return geometric(first, end, min(k + 4, LOG_POINTS - 4))


@jit
def _tail(loop, high, top, final):
    """Least abs(1 + L) beyond the grid: with dead time the curve turns, so 1 - abs(L) is reached."""
    if not loop.dead_time > 0.0:
        return 1.0
    beyond = math.sqrt(magnitude2(loop, top)) if top < high * (1.0 - 1e-9) else 0.0
    return max(1.0 - max(beyond, final), 0.0)


@jit
def _gain_margin(loop, omega, final):
    """Factor on the gain up to the first crossing of -180 degrees at -1; inf without one."""
    largest = min(final, 1.0) if loop.dead_time > 0.0 else 0.0
    turn = math.floor((phase(loop, omega[0]) + math.pi) / (2.0 * math.pi))
    for k in range(1, len(omega)):
        was, turn = turn, math.floor((phase(loop, omega[k]) + math.pi) / (2.0 * math.pi))
        if turn == was:
            continue
        target = 2.0 * math.pi * max(turn, was) - math.pi
        low, high = omega[k - 1], omega[k]
        for _ in range(50):
            middle = (low + high) / 2.0
            if (phase(loop, middle) < target) == (was > turn):
                high = middle
            else:
                low = middle
        size = math.sqrt(magnitude2(loop, high))
        if size < 1.0:
            largest = max(largest, size)
    return 1.0 / largest


@jit
def _without_gain(loop, known, out):
    """Write the figures (6,) of a loop whose gain is 0, which is stable but for integrators, or that is not known."""
    for k in range(STABLE):
        out[k] = math.nan
    out[STABLE] = 0.0
    if known and loop.g == 0.0:
        out[MS], out[MT] = math.inf, math.inf
        if loop.n == 0:
            out[MS], out[MT], out[GAIN], out[PHASE], out[DELAY] = 1.0, 0.0, math.inf, math.inf, math.inf
            out[STABLE] = 1.0


@jit
def _analyse_one(loop, full, out):
    """Write a loop's figures (6,), the margins with ``full`` alone."""
    total = loop.g + loop.a1 + loop.a2 + loop.dead_time
    for lag in loop.lags:
        total += lag
    _without_gain(loop, math.isfinite(total), out)
    if loop.g == 0.0 or not math.isfinite(total):
        return
    low, high = span(loop)
    high, final = _needed(loop, low, high, full), _final_gain(loop)
    linear, top = _linear_points(loop, high), high
    if linear == LINEAR_SIZES[-1]:
        # Thousands of turns: the rest is left to the tail.
        top = min(high, (BEND + linear * PHASE_STEP) / loop.dead_time)
    omega = grid(loop, low, top, linear)
    beyond = omega
    if top < high:
        # Crossovers beyond the grid decide about stability too; the magnitude alone is cheap to follow there.
        beyond = np.empty(len(omega) + LOG_POINTS - 1)
        for k in range(len(beyond)):
            beyond[k] = omega[k] if k < len(omega) else geometric(top, high, k - len(omega) + 1)
    turns, phase_margin, delay_margin = _crossings(loop, beyond)
    # Positive feedback is hopeless with an integrator or a gain above 1 at rest; a gain that never falls below 1 turns
    # for ever with dead time; without, it ends in phase.
    stable = turns == 0.0 and (loop.g > 0.0 or (loop.n == 0 and abs(loop.g) < 1.0))
    if not stable or not (final < 1.0 or loop.dead_time == 0.0):
        out[MS], out[MT] = math.inf, math.inf
        return
    out[STABLE] = 1.0
    for of in range(MS, MT + 1 if full else MT):  # a number that is no constant: compiled once
        out[of] = 1.0 / _least_distance(loop, omega, of)
    out[MS] = max(1.0, out[MS], 1.0 / _tail(loop, high, omega[-1], final))
    if full:
        out[GAIN], out[PHASE], out[DELAY] = _gain_margin(loop, omega, final), phase_margin, delay_margin


@jit
def _analyse(loops, full):
    """Return the figures of loops (L, 6)."""
    out = np.empty((len(loops.g), 6))
    for k in range(len(out)):
        _analyse_one(one_of(loops, k), full, out[k])
    return out


def peak_sensitivity(model: Process, settings: Settings) -> FloatOrArray:
    """Peak of the sensitivity ``Ms = max abs(1/(1 + C P))`` with exact dead time.

    Parameters
    ----------
    model, settings
        Process and controller; fields are floats or arrays that broadcast.

    Returns
    -------
    float or ndarray
        Ms, accurate to 0.1 %; inf where the closed loop is unstable, NaN where a field is NaN [-].
        A float for scalars, otherwise of the shape to which the fields broadcast.

    Examples
    --------
    >>> from tuners.models import IntegratingModel
    >>> model = IntegratingModel(gain=0.05, dead_time=4.0)
    >>> round(peak_sensitivity(model, Settings(kp=2.5, ti=32.0)), 2)
    1.7
    >>> peak_sensitivity(model, Settings(kp=10.0, ti=32.0))  # unstable
    inf
    """
    loops, shape = coefficients(model, settings)
    ms: Array = _analyse(loops, False)[:, MS]
    return float(ms[0]) if shape == () else ms.reshape(shape)


def margins(model: Process, settings: Settings) -> Margins:
    """Ms, Mt, gain, phase and delay margin, and stability, with exact dead time.

    Parameters
    ----------
    model, settings
        Process and controller; fields are floats or arrays that broadcast.

    Returns
    -------
    Margins
        Fields are floats for scalars, otherwise of the shape to which the fields broadcast.

    Examples
    --------
    >>> from tuners.models import IntegratingModel
    >>> found = margins(IntegratingModel(gain=0.05, dead_time=4.0), Settings(kp=2.5, ti=32.0))
    >>> f"GM {found.gain_margin:.2f}, PM {found.phase_margin:.1f} degrees, DM {found.delay_margin:.2f} s"
    'GM 2.96, PM 46.9 degrees, DM 6.36 s'
    """
    loops, shape = coefficients(model, settings)
    found: Array = _analyse(loops, True)

    def shaped(column: int) -> FloatOrArray:
        return float(found[0, column]) if shape == () else found[:, column].reshape(shape)

    stable = found[:, STABLE] == 1.0
    return Margins(
        shaped(MS),
        shaped(MT),
        shaped(GAIN),
        shaped(PHASE),
        shaped(DELAY),
        bool(stable[0]) if shape == () else stable.reshape(shape),
    )
