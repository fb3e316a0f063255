"""How safe a loop is: peak sensitivity Ms, margins and stability, with exact dead time, for many loops.

Stability needs no fine Nyquist curve: it is decided by the phase at the gain crossovers (see `_stable`).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from tuners.loops import BEND, HIGH_LEVEL, LOG_POINTS, Loops, coefficients, grid, high_end, span
from tuners.models import Array, FloatOrArray, Process
from tuners.settings import Settings

PHASE_STEP = 0.35  # dead time turns the curve by omega theta: no step beyond this angle [rad]
LINEAR_SIZES = (
    0,
    32,
    64,
    128,
    256,
    512,
    1024,
    4096,
)  # points of the linear part; loops are grouped by what they need
MS_ACCURACY = 1e-3  # of Ms: abs(L) below this is of no account
CHUNK_POINTS = 1 << 15  # points worked on at a time: a dozen arrays of them fit into the second-level cache


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


@dataclass(frozen=True, eq=False, slots=True)
class _Curve:
    """L on its grid: frequencies (points, L), real and imaginary part."""

    omega: Array
    re: Array
    im: Array


def _least_distance(loops: Loops, curve: _Curve, inverse: bool) -> Array:
    """Least abs(1 + L) over the grid, refined, or abs(1 + 1/L) with `inverse`; (L,)."""

    def distance2(re: Array, im: Array) -> Array:
        d2 = (1 + re) ** 2 + im * im
        return d2 / (re * re + im * im) if inverse else d2

    squared = distance2(curve.re, curve.im)
    columns = np.arange(squared.shape[1])
    best = np.sqrt(squared.min(axis=0))
    # Two peaks can be equally high within the grid's error: refine the two lowest local minima.
    inner = squared[1:-1]
    local = (inner <= squared[:-2]) & (inner <= squared[2:])
    candidates = np.where(local, inner, np.inf)
    rows, loop = [], []
    for _ in range(2):
        index = candidates.argmin(axis=0)
        found = np.flatnonzero(np.isfinite(candidates[index, columns]))
        rows.append(index[found] + 1)
        loop.append(found)
        candidates[index, columns] = np.inf
    row, of = np.concatenate(rows), np.concatenate(loop)  # both refined at once
    if of.size:
        ends = np.log(curve.omega[row - 1, of]), np.log(curve.omega[row + 1, of])
        np.minimum.at(best, of, _refine(loops.take(of), ends, distance2))
    return np.asarray(best)


def _refine(loops: Loops, ends: tuple[Array, Array], distance2: Callable[[Array, Array], Array]) -> Array:
    """Least distance between two log frequencies: two rounds of nine points, then a parabola; (L,)."""
    low, high = ends
    columns = np.arange(low.size)
    share = np.linspace(0.0, 1.0, 9)[:, np.newaxis]
    for _ in range(2):
        squared = distance2(*loops.parts(np.exp(low + share * (high - low))))
        index = np.clip(squared.argmin(axis=0), 1, 7)
        step = (high - low) / 8
        low, high = low + (index - 1) * step, low + (index + 1) * step
    left, middle, right = (squared[index + i, columns] for i in (-1, 0, 1))
    bend = left - 2 * middle + right
    slope = left - right
    drop = np.divide(slope * slope, 8 * bend, out=np.zeros_like(bend), where=bend > 0)
    # The parabola may dip below 0 where the curve runs through -1: there the nearest point counts.
    lowest = squared.min(axis=0)
    return np.asarray(np.sqrt(np.where(middle - drop > 0, np.minimum(middle - drop, lowest), lowest)))


def _gain_crossovers(loops: Loops, omega: Array) -> tuple[np.ndarray, Array, np.ndarray]:
    """Where abs(L) = 1: loop number, frequency [rad/s], and +1 for falling or -1 for rising gain."""
    excess = loops.magnitude2(omega) > 1
    row, loop = np.nonzero(excess[:-1] != excess[1:])
    picked = loops.take(loop)
    low, high = np.log(omega[row, loop]), np.log(omega[row + 1, loop])
    falling = excess[row, loop]
    f_low, f_high = (np.log(picked.magnitude2(np.exp(x))) for x in (low, high))
    was_low = was_high = np.zeros(loop.size, dtype=bool)
    for _ in range(60):  # Illinois variant of the false position: keeps the bracket, converges fast
        middle = (low * f_high - high * f_low) / (f_high - f_low)
        f = np.log(picked.magnitude2(np.exp(middle)))
        if not f.size or np.max(np.abs(f)) < 1e-11:
            break
        up = (f > 0) == falling  # the crossing lies above: the lower end moves
        f_low, f_high = (
            np.where(up, f, np.where(was_high, f_low / 2, f_low)),
            np.where(up, np.where(was_low, f_high / 2, f_high), f),
        )
        low, high = np.where(up, middle, low), np.where(up, high, middle)
        was_low, was_high = up, ~up
    return loop, np.exp(middle), np.where(falling, 1, -1)


def _stable(loops: Loops, crossings: tuple[np.ndarray, Array, np.ndarray], end: Array) -> np.ndarray:
    """Nyquist count from the phase at the gain crossovers; (L,), bool.

    L has no poles in the right half plane, so the loop is stable if arg(1 + L) turns by n pi/2 from
    omega = 0+ to infinity, which makes it end at 0. While abs(L) > 1, arg(1 + L) stays within pi/2 of the
    phase of L; while abs(L) < 1, within pi/2 of the multiple of 2 pi to which it has fallen. So the turns
    at falling crossovers less those at rising ones must vanish.
    """
    loop, omega, direction = crossings
    turns = np.floor((loops.take(loop).phase(omega) + math.pi) / (2 * math.pi))
    count = np.zeros(loops.g.size)
    np.add.at(count, loop, direction * turns)
    stable = count == 0
    # Positive feedback: hopeless with an integrator or a gain above 1 at rest.
    stable &= (loops.g > 0) | ((loops.n == 0) & (np.abs(loops.g) < 1))
    stable &= (loops.g != 0) | (loops.n == 0)
    # A gain that never falls below 1 turns for ever with dead time; without, it ends in phase.
    stable &= (end < 1) | (loops.dead_time == 0)
    return np.asarray(stable)


def _final_gain(loops: Loops) -> Array:
    """Return abs(L) at infinite frequency: 0 unless nothing rolls the loop off; inf for improper loops."""
    power = np.where(loops.a2 > 0, 2, np.where(loops.a1 > 0, 1, 0)) - loops.n - (loops.lags > 0).sum(axis=0)
    lead = np.where(loops.a2 > 0, loops.a2, np.where(loops.a1 > 0, loops.a1, 1.0))
    flat = np.abs(loops.g) * lead / np.prod(np.where(loops.lags > 0, loops.lags, 1.0), axis=0)
    return np.where(power > 0, np.inf, np.where(power == 0, flat, 0.0))


@dataclass(frozen=True, eq=False, slots=True)
class _Found:
    """Figures of one group of loops; each (L,)."""

    ms: Array
    mt: Array
    gain_margin: Array
    phase_margin: Array
    delay_margin: Array
    stable: np.ndarray


def _nothing_found(count: int) -> _Found:
    ms, mt, gain_margin, phase_margin, delay_margin = np.full((5, count), math.nan)
    return _Found(ms, mt, gain_margin, phase_margin, delay_margin, np.zeros(count, dtype=bool))


def _groups(loops: Loops, high: Array) -> list[tuple[int, np.ndarray]]:
    """Loops by the number of linear points that their dead time asks for: (points, loop numbers)."""
    angle = high * loops.dead_time - BEND
    needed = np.where(angle > 3, angle / PHASE_STEP, 0)
    group = np.minimum(np.searchsorted(LINEAR_SIZES, needed), len(LINEAR_SIZES) - 1)
    result = []
    for size in np.unique(group):
        members = np.flatnonzero(group == size)
        chunk = max(1, CHUNK_POINTS // (LOG_POINTS + LINEAR_SIZES[size]))
        parts = np.array_split(members, math.ceil(members.size / chunk))
        result += [(LINEAR_SIZES[size], part) for part in parts]
    return result


def _needed(loops: Loops, low: Array, high: Array, full: bool) -> Array:
    """Highest frequency [rad/s] that can matter for Ms, after a first look below one turn of the dead time.

    What has been seen there is a lower bound of Ms: beyond the frequency where abs(L) falls below 1 - 1/Ms
    nothing can surpass it.
    """
    index = np.flatnonzero(high * loops.dead_time > BEND + 3)
    if not index.size:
        return high
    turning, trimmed = loops.take(index), high.copy()
    re, im = turning.parts(grid(turning, low[index], BEND / turning.dead_time, 0)[::2])
    seen = np.sqrt(((1 + re) ** 2 + im * im).min(axis=0))
    # The margins are exact down to the same level of abs(L) as everywhere.
    level = np.clip(1 - seen, MS_ACCURACY, HIGH_LEVEL if full else 0.9)
    end = high_end(turning, level)
    # The bound is generous; abs(L) itself, which is smooth out there, says how far it really is.
    steps = grid(turning, 5 / turning.dead_time, end, 0)[::4]
    above = turning.magnitude2(steps) > (0.9 * level) ** 2
    last = np.where(above.any(axis=0), len(steps) - 1 - above[::-1].argmax(axis=0), 0)
    trimmed[index] = steps[np.minimum(last + 1, len(steps) - 1), np.arange(index.size)]
    return trimmed


def _tail(loops: Loops, high: Array, omega: Array, final: Array) -> Array:
    """Least abs(1 + L) beyond the grid (L,): with dead time the curve turns, so 1 - abs(L) is reached."""
    last = np.sqrt(loops.magnitude2(omega[-1]))
    beyond = np.where(omega[-1] < high * (1 - 1e-9), last, 0.0)
    turning = np.where(loops.dead_time > 0, np.maximum(beyond, final), 0.0)
    return np.asarray(np.maximum(1 - turning, 0.0))


@np.errstate(divide="ignore", over="ignore", under="ignore", invalid="ignore")
def _analyse(loops: Loops, full: bool) -> _Found:
    """Ms, and with `full` the margins, of loops (L,); infinities and NaN on the way are meant."""
    count = loops.g.size
    out = _nothing_found(count)
    known = np.isfinite(loops.g + loops.a1 + loops.a2 + loops.dead_time + loops.lags.sum(axis=0))
    low, high = span(loops)
    high = _needed(loops, low, high, full)
    final = _final_gain(loops)
    idle = known & (loops.g == 0)
    index = np.flatnonzero(known & ~idle)
    active = loops.take(index)
    for linear, members in _groups(active, high[index]) if index.size else ():
        rows = index[members]
        _analyse_group(loops.take(rows), low[rows], high[rows], final[rows], linear, full, out, rows)
    out.stable[idle] = loops.n[idle] == 0
    out.ms[idle] = np.where(out.stable[idle], 1.0, np.inf)
    out.mt[idle] = np.where(out.stable[idle], 0.0, np.inf)
    out.gain_margin[idle] = out.phase_margin[idle] = out.delay_margin[idle] = np.where(
        out.stable[idle], np.inf, np.nan
    )
    return out


def _analyse_group(
    loops: Loops,
    low: Array,
    high: Array,
    final: Array,
    linear: int,
    full: bool,
    out: _Found,
    rows: np.ndarray,
) -> None:
    """Write the figures of loops that share a size of grid into `out` at `rows`."""
    top = high
    if linear == LINEAR_SIZES[-1]:
        # Thousands of turns: the rest is left to the tail.
        top = np.minimum(high, (BEND + linear * PHASE_STEP) / loops.dead_time)
    omega = grid(loops, low, top, linear)
    curve = _Curve(omega, *loops.parts(omega))
    # Crossovers beyond the grid decide about stability too; the magnitude alone is cheap to follow there.
    beyond = omega
    if np.any(top < high):
        more = np.exp(np.linspace(0.0, 1.0, LOG_POINTS)[1:, np.newaxis] * np.log(high / top)) * top
        beyond = np.concatenate([omega, more])
    crossings = _gain_crossovers(loops, beyond)
    stable = _stable(loops, crossings, final)
    tail = _tail(loops, high, omega, final)
    out.ms[rows] = np.where(
        stable, np.maximum(1.0, 1 / np.minimum(_least_distance(loops, curve, False), tail)), np.inf
    )
    out.stable[rows] = stable
    if not full:
        return
    out.mt[rows] = np.where(stable, 1 / _least_distance(loops, curve, True), np.inf)
    phase, delay = _phase_margins(loops, crossings)
    out.phase_margin[rows] = np.where(stable, phase, np.nan)
    out.delay_margin[rows] = np.where(stable, delay, np.nan)
    out.gain_margin[rows] = np.where(stable, _gain_margin(loops, omega, final), np.nan)


def _phase_margins(loops: Loops, crossings: tuple[np.ndarray, Array, np.ndarray]) -> tuple[Array, Array]:
    """Phase margin [degrees] and delay margin [s], the least over all gain crossovers; (L,)."""
    loop, omega, _ = crossings
    above = np.mod(loops.take(loop).phase(omega) + math.pi, 2 * math.pi)
    phase, delay = np.full(loops.g.size, np.inf), np.full(loops.g.size, np.inf)
    np.minimum.at(phase, loop, np.degrees(np.minimum(above, 2 * math.pi - above)))
    np.minimum.at(delay, loop, above / omega)
    return phase, delay


def _gain_margin(loops: Loops, omega: Array, final: Array) -> Array:
    """Factor on the gain up to the first crossing of -180 degrees at -1; inf without one; (L,)."""
    turn = np.floor((loops.phase(omega) + math.pi) / (2 * math.pi))
    row, loop = np.nonzero(turn[:-1] != turn[1:])
    picked = loops.take(loop)
    target = 2 * math.pi * np.maximum(turn[row, loop], turn[row + 1, loop]) - math.pi
    low, high = omega[row, loop], omega[row + 1, loop]
    falling = turn[row, loop] > turn[row + 1, loop]
    for _ in range(50):
        middle = (low + high) / 2
        passed = (picked.phase(middle) < target) == falling
        low, high = np.where(passed, low, middle), np.where(passed, middle, high)
    size = np.sqrt(picked.magnitude2(high))
    largest = np.where(loops.dead_time > 0, np.minimum(final, 1.0), 0.0)
    np.maximum.at(largest, loop, np.where(size < 1, size, 0.0))
    return np.asarray(1 / largest)


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
    ms = _analyse(loops, full=False).ms
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
    found = _analyse(loops, full=True)

    def shaped(figure: Array) -> FloatOrArray:
        return float(figure[0]) if shape == () else figure.reshape(shape)

    return Margins(
        shaped(found.ms),
        shaped(found.mt),
        shaped(found.gain_margin),
        shaped(found.phase_margin),
        shaped(found.delay_margin),
        bool(found.stable[0]) if shape == () else found.stable.reshape(shape),
    )
