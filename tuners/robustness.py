"""How safe a loop is: peak sensitivity Ms, margins and stability, with exact dead time, for many loops.

Written out over one denominator, the loop gain of every model and PID form is

    L(s) = g (1 + a1 s + a2 s^2) e^(-theta s) / (s^n (T1 s + 1)(T2 s + 1)(tf s + 1)),   n = 0, 1 or 2

without poles in the right half plane. So its magnitude and its *continuous* phase are known in closed form,
and stability needs no fine Nyquist curve: it is decided by the phase at the gain crossovers (see `_stable`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from itertools import product

import numpy as np

from tuners.models import Array, FloatOrArray, IntegratingModel, Model, SelfRegulatingModel
from tuners.responses import Response, closed_loop_response
from tuners.settings import Settings

__all__ = [
    "Margins",
    "Response",
    "closed_loop_response",
    "margins",
    "model_box",
    "peak_sensitivity",
    "worst_sensitivity",
]

LOW_LEVEL = 30.0  # below the frequency where |L| falls to this, |S| is under 1/29: no peak, no crossover
HIGH_LEVEL = 0.1  # above the frequency where |L| falls to this, |S| differs from 1 by 11 % at most
LOG_POINTS = 128  # 4 to 5 decades at 8-10 % a step: neighbouring peaks stay apart, the rest is refinement
PHASE_STEP = 0.35  # dead time turns the curve by omega theta: no step beyond this angle [rad]
LINEAR_SIZES = (0, 64, 256, 1024, 4096)  # points of the linear part; loops are grouped by what they need
CHUNK = 1 << 15  # points worked on at a time: a dozen arrays of them fit into the second-level cache


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


@dataclass(frozen=True, slots=True)
class _Loops:
    """Coefficients of L(s), each an array (L,); `lags` is (3, L): T1, T2 and the filter; `n` is a float."""

    g: Array
    a1: Array
    a2: Array
    dead_time: Array
    lags: Array
    n: Array

    def take(self, index: np.ndarray) -> _Loops:
        """Return the loops at `index`."""
        return _Loops(
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
        t1, t2, tf = self.lags * self.lags
        poles = (1 + t1 * x) * (1 + t2 * x) * (1 + tf * x)
        power = np.where(self.n == 0, 1.0, np.where(self.n == 1, x, x * x))
        result: Array = self.g * self.g * numerator / (poles * power)
        return result

    def phase(self, omega: Array) -> Array:
        """Continuous phase of L at omega (..., L), with 0 for g > 0 at the origin before the poles [rad]."""
        lead = np.arctan2(self.a1 * omega, 1 - self.a2 * omega * omega)
        lag = sum(np.arctan(lag * omega) for lag in self.lags)
        sign = np.where(self.g < 0, math.pi, 0.0)
        result: Array = sign + lead - lag - self.n * (math.pi / 2) - omega * self.dead_time
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


def _coefficients(model: Model, settings: Settings) -> tuple[_Loops, tuple[int, ...]]:
    """Write model and settings as L(s), with the shape that they broadcast to."""
    lag2: FloatOrArray = model.lag2 if isinstance(model, SelfRegulatingModel) else 0.0
    fields = (
        model.gain, model.dead_time, model.lag, lag2,
        settings.kp, settings.ti, settings.td, settings.filter_time,
    )  # fmt: skip
    arrays = np.broadcast_arrays(*fields)
    gain, dead_time, lag, lag2, kp, ti, td, tf = (np.asarray(a, dtype=float).ravel() for a in arrays)
    integral = np.isfinite(ti)
    safe_ti = np.where(integral, ti, 1.0)
    if settings.form == "series":
        a1, a2 = np.where(integral, safe_ti + td, td), np.where(integral, safe_ti * td, 0.0)
    else:
        a1 = np.where(integral, safe_ti, td) + tf
        a2 = np.where(integral, safe_ti * (tf + td), 0.0)
    n = integral.astype(float) + isinstance(model, IntegratingModel)
    loops = _Loops(gain * kp / safe_ti, a1, a2, dead_time, np.stack([lag, lag2, tf]), n)
    return loops, arrays[0].shape


def _reach(c: Array, order: Array, lags: Array) -> Array:
    """Frequency beyond which ``c omega^-order / prod max(1, omega lag)`` stays below 1 [rad/s].

    Each subset of the lags, taken as pure integrations, bounds the term from above; the least counts.
    0 where the term is below 1 everywhere, inf where it never falls below.
    """
    best = np.full(c.shape, np.inf)
    with np.errstate(divide="ignore", over="ignore", invalid="ignore"):
        for chosen in product((False, True), repeat=len(lags)):
            divisor = np.prod(lags[list(chosen)], axis=0)
            total = order + sum(chosen)
            power = (c / divisor) ** (1 / np.maximum(total, 1))
            flat = np.where((total == 0) & (c <= divisor), 0.0, np.inf)
            best = np.where(divisor > 0, np.minimum(best, np.where(total > 0, power, flat)), best)
    return best


def _span(loops: _Loops) -> tuple[Array, Array]:
    """Lowest and highest frequency worth looking at [rad/s]."""
    g, lags = np.abs(loops.g), loops.lags
    numerator = (np.ones_like(g), loops.a1, loops.a2)
    # |numerator| <= 1 + a1 w + a2 w^2: with each term below a third of the level, so is their sum.
    high = np.max(
        [_reach(3 * g * a / HIGH_LEVEL, loops.n - i, lags) for i, a in enumerate(numerator)], axis=0
    )
    # Slow loops peak where the phase is, not where the gain is; 5/theta lies beyond -180 degrees.
    total = loops.dead_time + lags.sum(axis=0) + loops.a1
    total = np.where(total > 0, total, 1.0)
    shortest = np.where(lags > 0, lags, np.inf).min(axis=0)
    with np.errstate(divide="ignore"):
        phase = np.where(loops.dead_time > 0, 5 / loops.dead_time, np.maximum(30 / shortest, 30 / total))
    high = np.maximum(np.where(np.isfinite(high), high, 20 * phase), phase)
    # |numerator| >= max(1/2, a1 w) while a2 w^2 <= 1/2, and 1 + w lag <= 2 max(1, w lag).
    c = g / (LOW_LEVEL * 2.0 ** (lags > 0).sum(axis=0))
    slow = np.where(
        loops.n > 0, np.maximum(_reach(c / 2, loops.n, lags), _reach(c * loops.a1, loops.n - 1, lags)), 0
    )
    low = np.where((slow > 0) & np.isfinite(slow), slow, 1e-3 / total)
    with np.errstate(divide="ignore"):
        low = np.minimum(low, np.sqrt(0.5 / loops.a2))
    return np.minimum(low, high / 100), high


def _grid(loops: _Loops, low: Array, high: Array, linear: int) -> Array:
    """Frequencies (points, L) [rad/s]: geometric up to about one radian of dead time, then even steps."""
    bend = np.minimum(high, _bend(loops.dead_time)) if linear else high
    share = np.linspace(0.0, 1.0, LOG_POINTS)[:, np.newaxis]
    logs = np.log(low)
    grid = np.exp(logs + share * (np.log(bend) - logs))
    if not linear:
        return grid
    rest = np.arange(1, linear + 1)[:, np.newaxis] / linear
    return np.concatenate([grid, bend + rest * (high - bend)])


def _bend(dead_time: Array) -> Array:
    """Frequency from which even steps are finer than geometric ones [rad/s]."""
    with np.errstate(divide="ignore"):
        return 4 / dead_time


@dataclass(frozen=True, slots=True)
class _Curve:
    """L on its grid: frequencies (points, L), real and imaginary part."""

    omega: Array
    re: Array
    im: Array


def _least_distance(loops: _Loops, curve: _Curve, inverse: bool) -> Array:
    """Least abs(1 + L) over the grid, refined, or abs(1 + 1/L) with `inverse`; (L,)."""

    def distance2(re: Array, im: Array) -> Array:
        d2 = (1 + re) ** 2 + im * im
        return d2 / (re * re + im * im) if inverse else d2

    squared = distance2(curve.re, curve.im)
    points, count = squared.shape
    columns = np.arange(count)
    best = np.sqrt(squared.min(axis=0))
    # Two peaks can be equally high within the grid's error: refine the two lowest local minima.
    inner = squared[1:-1]
    local = (inner <= squared[:-2]) & (inner <= squared[2:])
    candidates = np.where(local, inner, np.inf)
    for _ in range(2):
        index = candidates.argmin(axis=0)
        found = np.isfinite(candidates[index, columns])
        index = np.clip(index + 1, 1, points - 2)
        ends = np.log(curve.omega[index - 1, columns]), np.log(curve.omega[index + 1, columns])
        refined = _refine(loops, ends, distance2)
        best = np.where(found, np.minimum(best, refined), best)
        candidates[index - 1, columns] = np.inf
    return best


def _refine(loops: _Loops, ends: tuple[Array, Array], distance2: Callable[[Array, Array], Array]) -> Array:
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
    # The parabola may dip below 0 by rounding where the curve runs through -1.
    return np.sqrt(np.maximum(np.minimum(middle - drop, squared.min(axis=0)), 0.0))


def _gain_crossovers(loops: _Loops, omega: Array) -> tuple[np.ndarray, Array, np.ndarray]:
    """Where abs(L) = 1: loop number, frequency [rad/s], and +1 for falling or -1 for rising gain."""
    excess = loops.magnitude2(omega) > 1
    row, loop = np.nonzero(excess[:-1] != excess[1:])
    picked = loops.take(loop)
    low, high = np.log(omega[row, loop]), np.log(omega[row + 1, loop])
    falling = excess[row, loop]
    f_low, f_high = (np.log(picked.magnitude2(np.exp(x))) for x in (low, high))
    for _ in range(60):  # Illinois variant of the false position: keeps the bracket, converges fast
        middle = (low * f_high - high * f_low) / (f_high - f_low)
        f = np.log(picked.magnitude2(np.exp(middle)))
        if not f.size or np.max(np.abs(f)) < 1e-12 or np.max(high - low) < 1e-14:
            break
        beyond = (f > 0) != falling
        low, f_low = np.where(beyond, low, middle), np.where(beyond, f_low / 2, f)
        high, f_high = np.where(beyond, middle, high), np.where(beyond, f, f_high / 2)
    else:
        middle = (low + high) / 2
    return loop, np.exp(middle), np.where(falling, 1, -1)


def _stable(loops: _Loops, crossings: tuple[np.ndarray, Array, np.ndarray], end: Array) -> np.ndarray:
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
    return stable


def _final_gain(loops: _Loops) -> Array:
    """Return abs(L) at infinite frequency: 0 unless nothing rolls the loop off; inf for improper loops."""
    power = np.where(loops.a2 > 0, 2, np.where(loops.a1 > 0, 1, 0)) - loops.n - (loops.lags > 0).sum(axis=0)
    lead = np.where(loops.a2 > 0, loops.a2, np.where(loops.a1 > 0, loops.a1, 1.0))
    flat = np.abs(loops.g) * lead / np.prod(np.where(loops.lags > 0, loops.lags, 1.0), axis=0)
    return np.where(power > 0, np.inf, np.where(power == 0, flat, 0.0))


@dataclass(frozen=True, slots=True)
class _Found:
    """Figures of one group of loops; each (L,)."""

    ms: Array
    mt: Array
    gain_margin: Array
    phase_margin: Array
    delay_margin: Array
    stable: np.ndarray


def _groups(loops: _Loops, high: Array) -> list[tuple[int, np.ndarray]]:
    """Loops by the number of linear points that their dead time asks for: (points, loop numbers)."""
    angle = high * loops.dead_time - 4
    needed = np.where(angle > 3, angle / PHASE_STEP, 0)
    group = np.minimum(np.searchsorted(LINEAR_SIZES, needed), len(LINEAR_SIZES) - 1)
    result = []
    for size in np.unique(group):
        members = np.flatnonzero(group == size)
        chunk = max(1, CHUNK // (LOG_POINTS + LINEAR_SIZES[size]))
        parts = np.array_split(members, math.ceil(members.size / chunk))
        result += [(LINEAR_SIZES[size], part) for part in parts]
    return result


def _tail(loops: _Loops, high: Array, omega: Array, final: Array) -> Array:
    """Least abs(1 + L) beyond the grid (L,): with dead time the curve turns, so 1 - abs(L) is reached."""
    last = np.sqrt(loops.magnitude2(omega[-1]))
    beyond = np.where(omega[-1] < high * (1 - 1e-9), last, 0.0)
    turning = np.where(loops.dead_time > 0, np.maximum(beyond, final), 0.0)
    return np.maximum(1 - turning, 0.0)


def _analyse(loops: _Loops, full: bool) -> _Found:
    """Ms, and with `full` the margins, of loops (L,)."""
    count = loops.g.size
    out = _Found(*(np.full(count, math.nan) for _ in range(5)), np.zeros(count, dtype=bool))
    known = np.isfinite(loops.g + loops.a1 + loops.a2 + loops.dead_time + loops.lags.sum(axis=0))
    low, high = _span(loops)
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
    loops: _Loops,
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
        top = np.minimum(high, (4 + linear * PHASE_STEP) / loops.dead_time)
    omega = _grid(loops, low, top, linear)
    curve = _Curve(omega, *loops.parts(omega))
    # Crossovers beyond the grid decide about stability too; the magnitude alone is cheap to follow there.
    beyond = omega
    if np.any(top < high):
        more = np.exp(np.linspace(0.0, 1.0, LOG_POINTS)[1:, np.newaxis] * np.log(high / top)) * top
        beyond = np.concatenate([omega, more])
    crossings = _gain_crossovers(loops, beyond)
    stable = _stable(loops, crossings, final)
    tail = _tail(loops, high, omega, final)
    with np.errstate(divide="ignore"):
        out.ms[rows] = np.where(
            stable, np.maximum(1.0, 1 / np.minimum(_least_distance(loops, curve, False), tail)), np.inf
        )
    out.stable[rows] = stable
    if not full:
        return
    with np.errstate(divide="ignore", invalid="ignore"):
        out.mt[rows] = np.where(stable, 1 / _least_distance(loops, curve, True), np.inf)
    phase, delay = _phase_margins(loops, crossings)
    out.phase_margin[rows] = np.where(stable, phase, np.nan)
    out.delay_margin[rows] = np.where(stable, delay, np.nan)
    out.gain_margin[rows] = np.where(stable, _gain_margin(loops, omega, final), np.nan)


def _phase_margins(loops: _Loops, crossings: tuple[np.ndarray, Array, np.ndarray]) -> tuple[Array, Array]:
    """Phase margin [degrees] and delay margin [s], the least over all gain crossovers; (L,)."""
    loop, omega, _ = crossings
    above = np.mod(loops.take(loop).phase(omega) + math.pi, 2 * math.pi)
    phase, delay = np.full(loops.g.size, np.inf), np.full(loops.g.size, np.inf)
    np.minimum.at(phase, loop, np.degrees(np.minimum(above, 2 * math.pi - above)))
    np.minimum.at(delay, loop, above / omega)
    return phase, delay


def _gain_margin(loops: _Loops, omega: Array, final: Array) -> Array:
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
    with np.errstate(divide="ignore"):
        return np.asarray(1 / largest)


def peak_sensitivity(model: Model, settings: Settings) -> FloatOrArray:
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
    """
    loops, shape = _coefficients(model, settings)
    ms = _analyse(loops, full=False).ms
    return float(ms[0]) if shape == () else ms.reshape(shape)


def margins(model: Model, settings: Settings) -> Margins:
    """Ms, Mt, gain, phase and delay margin, and stability, with exact dead time.

    Parameters
    ----------
    model, settings
        Process and controller; fields are floats or arrays that broadcast.

    Returns
    -------
    Margins
        Fields are floats for scalars, otherwise of the shape to which the fields broadcast.
    """
    loops, shape = _coefficients(model, settings)
    found = _analyse(loops, full=True)
    figures = (found.ms, found.mt, found.gain_margin, found.phase_margin, found.delay_margin)
    if shape == ():
        return Margins(*(float(figure[0]) for figure in figures), bool(found.stable[0]))
    return Margins(*(figure.reshape(shape) for figure in figures), found.stable.reshape(shape))


def worst_sensitivity(models: Model | Iterable[Model], settings: Settings) -> float:
    """Largest Ms of one controller over several models (a model with array fields, or a list of models).

    Returns
    -------
    float
        inf as soon as one of the loops is unstable; NaN models are ignored; NaN where all are [-].
    """
    if isinstance(models, IntegratingModel | SelfRegulatingModel):
        models = [models]
    values = [np.atleast_1d(peak_sensitivity(model, settings)).ravel() for model in models]
    every = np.concatenate(values) if values else np.array([])
    every = every[~np.isnan(every)]
    return float(every.max()) if every.size else math.nan


def model_box(
    process: str,
    gain: tuple[float, float],
    dead_time: tuple[float, float],
    lag: tuple[float, float] = (0.0, 0.0),
    steps: int = 3,
) -> Model:
    """Grid of models over a box of intervals, for `worst_sensitivity`.

    Parameters
    ----------
    process
        'integrating' or 'self-regulating'.
    gain
        Lowest and highest gain, of one sign [PV/(OP s)] or [PV/OP].
    dead_time, lag
        Lowest and highest value [s].
    steps
        Values in each interval, at least 2: the corners; 3 adds the middles.

    Returns
    -------
    IntegratingModel or SelfRegulatingModel
        Fields are arrays (steps^3,).
    """
    if gain[0] * gain[1] <= 0:
        raise ValueError(f"gain = {gain}: the interval must not contain 0")
    axes = (np.linspace(*interval, steps) for interval in (gain, dead_time, lag))
    fields = (field.ravel() for field in np.meshgrid(*axes))
    return (IntegratingModel if process == "integrating" else SelfRegulatingModel)(*fields)
