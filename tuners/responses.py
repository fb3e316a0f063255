"""Closed-loop responses to unit steps, with exact dead time, from the frequency response.

A stable loop that settles within a half period answers a square wave with its step response in each half.
A square wave has odd harmonics only, so that one inverse Fourier transform gives the whole response:
no time stepping, no approximation of the dead time, and stiff loops cost what others cost.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from tuners.loops import coefficients
from tuners.models import (
    INTEGRATING,
    SELF_REGULATING,
    Array,
    ComplexArray,
    FloatOrArray,
    Process,
    SelfRegulatingModel,
)
from tuners.robustness import peak_sensitivity
from tuners.settings import Settings
from tuners.spectrum import SETTLED_SHARE, figures_of, first_window, points, spectra

MIN_POINTS, MAX_POINTS = 1 << 11, 1 << 17
FIGURE_POINTS = 512, 1 << 14  # least and most samples for figures without curves
SETTLING_SHARE = 0.02  # the usual 2 % band of the settling time


@dataclass(frozen=True, eq=False, slots=True)
class Response:
    """Response to a unit step at time 0.

    Parameters
    ----------
    time
        Time from the step on (N,) [s].
    pv, op
        Deviations from the state before the step (N,) [PV], [OP]. The controller's output alone: a load
        is not included in `op`.
    iae
        Integrated absolute error; inf with a lasting offset or an unstable loop [PV s].
    overshoot
        Excess over the final value as a share of the step (set point); excursion to the other side as a
        share of the peak (load); NaN where unstable [-].
    settling_time
        When PV has entered the 2 % band for good: 2 % of the step (set point) or of the peak (load);
        inf where unstable [s].
    """

    time: Array
    pv: Array
    op: Array
    iae: float
    overshoot: float
    settling_time: float


def closed_loop_response(
    model: Process, settings: Settings, kind: str = "setpoint", *, duration: float | None = None
) -> Response:
    """Response of the closed loop to a unit step of the set point or of a load at the process input.

    Parameters
    ----------
    model, settings
        Process and controller, scalar fields. The set-point weights of the settings count.
    kind
        'setpoint' (unit [PV]) or 'load' (unit [OP], added to OP).
    duration
        Length of the returned response; by default until the loop has settled [s].

    Returns
    -------
    Response
        For an unstable loop `time`, `pv` and `op` are empty and `iae` is inf. An ideal derivative
        (tf = 0) that acts on the set point is simulated with tf = td/1000, and a process without any lag
        with a lag of a thousandth of the dead time, since both answer a step with an impulse or a jump.

    Raises
    ------
    ValueError
        For another kind, array fields, or a duration that is not above 0.

    Examples
    --------
    >>> from tuners.models import IntegratingModel
    >>> model, settings = IntegratingModel(gain=1.0, dead_time=1.0), Settings(kp=0.5, ti=8.0)
    >>> response = closed_loop_response(model, settings, "load")
    >>> f"IAE = {response.iae:.2f}, settled after {response.settling_time:.0f} s"
    'IAE = 16.00, settled after 26 s'
    """
    if kind not in {"setpoint", "load"}:
        raise ValueError(f"kind = {kind!r}: must be 'setpoint' or 'load'")
    if duration is not None and not 0 < duration < math.inf:
        raise ValueError(f"duration = {duration}: must be above 0 [s]")
    ms = peak_sensitivity(model, settings)
    if not isinstance(ms, float):
        raise ValueError("closed_loop_response takes one loop: fields must be scalars")  # noqa: TRY004
    if not math.isfinite(ms):
        nothing = np.array([])
        return Response(nothing, nothing, nothing, math.inf, math.nan, math.inf)
    model, settings = _proper(model, settings)
    window = float(first_window(model, settings)[0])
    if duration is not None:
        window = max(window, 1.01 * duration)
    for _ in range(12):
        time, pv, op = _square_wave(model, settings, kind, window)
        final = float(_final_value(model, settings, kind))
        scale = max(1.0 if kind == "setpoint" else 0.0, float(np.abs(pv).max()))
        # The last samples feel the next flank: a cut series rings a little ahead of a kink.
        if np.abs(pv[-len(pv) // 10 : -len(pv) // 50] - final).max() < SETTLED_SHARE * scale:
            break
        window *= 2
    pv[time <= float(model.dead_time)] = 0.0  # causality, where the cut series rings a little
    keep = time <= (duration if duration is not None else 0.98 * window)
    return _figures(time, pv, op, kind, final, keep)


@dataclass(frozen=True, eq=False, slots=True)
class Figures:
    """Figures of unit steps of many controllers on one process; arrays (T,), inf and NaN as in `Response`.

    Parameters
    ----------
    overshoot
        After a set-point step, as a share of it [-].
    iae_setpoint, iae_load
        Integrated absolute error after a set-point [s] and a load step [PV s/OP].
    """

    overshoot: Array
    iae_setpoint: Array
    iae_load: Array


def step_figures(model: Process, settings: Settings, stable: NDArray[np.bool_] | None = None) -> Figures:
    """Overshoot and IAE of unit steps for many controllers at once, without curves; IAE within 0.5 %.

    Parameters
    ----------
    model
        Process, scalar fields.
    settings
        Controllers, fields that broadcast to (T,).
    stable
        Which loops (T,) are stable, where that is known already.

    Examples
    --------
    >>> from tuners.models import IntegratingModel
    >>> many = Settings(kp=np.array([0.3, 0.5, 0.7]), ti=8.0)
    >>> step_figures(IntegratingModel(gain=1.0, dead_time=1.0), many).overshoot.round(2)
    array([0.27, 0.28, 0.42])
    """
    if stable is None:
        stable = np.isfinite(np.atleast_1d(peak_sensitivity(model, settings)))
    model, _ = _proper(model, Settings(1.0))
    rows = np.empty((6, stable.size))
    for k, name in enumerate(("kp", "ti", "td", "tf", "b", "c")):
        rows[k] = getattr(settings, name)
    _, _, td, tf, _, c = rows
    rows[3] = np.where((td > 0) & (tf == 0) & (c != 0), td / 1000, np.where(td != 0, tf, 0.0))
    figures = np.tile(np.array([[math.nan], [math.inf], [math.inf]]), stable.size)
    alone, _ = coefficients(model, Settings(1.0))
    todo = np.flatnonzero(stable)
    window = first_window(model, _columns(rows[:, todo], settings.form)) if todo.size else np.zeros(0)
    for _ in range(12):
        if not todo.size:
            break
        kept = rows.take(todo, axis=1)
        many = _columns(kept, settings.form)
        count = points(model, many, window, 0.1, *FIGURE_POINTS)
        waves = np.fft.ifft(spectra(alone, kept, settings.form == "series", window, count), axis=-1)
        final = np.stack([_final_value(model, many, kind) for kind in ("setpoint", "load")])
        *found, settled = figures_of(waves, _turns(count)[0], window, final, float(model.dead_time))
        figures[:, todo] = found
        todo, window = todo[settled == 0.0], 2.0 * window[settled == 0.0]
    return Figures(*figures)


def _columns(rows: Array, form: str) -> Settings:
    """Return settings with fields (L,) of rows kp, ti, td, tf, b, c (6, L)."""
    kp, ti, td, tf, b, c = rows
    return Settings(kp, ti, td, tf, form, b, c)


def _proper(model: Process, settings: Settings) -> tuple[Process, Settings]:
    """Give an improper loop the smallest roll-off that keeps its response finite."""
    if settings.td != 0 and settings.tf == 0 and settings.c != 0:
        settings = replace(settings, tf=settings.td / 1000)
    if model.process == SELF_REGULATING and not any(float(lag) > 0 for lag in model.lags):
        model = SelfRegulatingModel(model.gain, model.dead_time, model.dead_time / 1000)
    return model, settings


def _square_wave(model: Process, settings: Settings, kind: str, window: float) -> tuple[Array, Array, Array]:
    """Time [s], PV and OP of one half period."""
    count = points(model, settings, np.array([window]), 0.03, MIN_POINTS, MAX_POINTS)
    omega = np.arange(1, 2 * count, 2) * np.float64(math.pi / window)
    process, feedback = model.frequency_response(omega), settings.frequency_response(omega)
    closed = 1 / (1 + process * feedback)
    time = np.linspace(0.0, window, 2 * count + 1)
    if kind == "load":
        pv = _half_wave(process * closed, count) + _final_value(model, settings, kind) / 2
        op = _half_wave(-feedback * process * closed, count) - _rest(model, settings) / 2
        return time, pv, op
    path = settings.setpoint_response(omega)
    pv = _half_wave(path * process * closed, count) + _final_value(model, settings, kind) / 2
    # OP jumps with the set point: P and D kicks are added in closed form, the series carries the rest.
    tf, kick = float(settings.filter_time), _derivative_kick(settings)
    s = 1j * omega
    jump = settings.kp * settings.b + kick * tf * s / (tf * s + 1)
    op = _half_wave(path * closed - jump, count) + _final_op(model, settings) / 2
    op += float(settings.kp * settings.b) / 2
    if tf > 0:
        # Each flank of the square wave decays from a full jump; the one before is long gone.
        op += kick * np.exp(-time / tf)
    return time, pv, op


def _derivative_kick(settings: Settings) -> float:
    """Jump of OP by the filtered derivative of a unit set-point step [OP]."""
    tf = float(settings.filter_time)
    if tf == 0:
        return 0.0
    if settings.form == "series":
        return float(settings.kp * settings.b * settings.c * (settings.td - tf) / tf)
    return float(settings.kp * settings.c * settings.td / tf)


def _half_wave(transfer: ComplexArray, count: int) -> Array:
    """Return the first half period (2 count + 1,) of the answer of `transfer` to a square wave of +-1/2."""
    spectrum = np.zeros(2 * count + 1, dtype=complex)
    harmonics = np.arange(1, 2 * count, 2)
    spectrum[harmonics] = transfer / (1j * math.pi * harmonics)
    wave = np.fft.irfft(spectrum, 4 * count) * (4 * count)
    return np.asarray(wave[: 2 * count + 1])


@lru_cache(maxsize=8)  # of powers of two, `FIGURE_POINTS`
def _turns(count: int) -> tuple[ComplexArray, ComplexArray]:
    """Return half a turn in so many steps, and a square wave's odd harmonics; (count,) each."""
    turn = np.exp(1j * math.pi / count * np.arange(count)).astype(np.complex128)
    harmonics = (1j * math.pi * np.arange(1, 2 * count, 2)).astype(np.complex128)
    return turn, harmonics


def _half_waves(transfer: ComplexArray) -> Array:
    """Return the first half period (L, count) of the answers (L, count) to the same square wave, without its end.

    The odd harmonics 2m + 1 are the harmonics m turned on by half a turn over the half period.
    """
    count = transfer.shape[-1]
    turn, harmonics = _turns(count)
    wave = np.fft.ifft(transfer / harmonics, axis=-1)
    return np.asarray(2.0 * count * (wave * turn).real)


def _rest(model: Process, settings: Settings) -> FloatOrArray:
    """Return the final complementary sensitivity: 1 with integral action or an integrator [-]."""
    gain = model.gain * settings.kp
    return np.where(np.isfinite(settings.ti) | (model.process == INTEGRATING), 1.0, gain / (1 + gain))


def _final_value(model: Process, settings: Settings, kind: str) -> FloatOrArray:
    """PV that the loop settles at [PV]."""
    rest, integral = _rest(model, settings), np.isfinite(settings.ti)
    if kind == "load":
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.where(integral, 0.0, rest / np.asarray(settings.kp))
    return np.where(integral, rest, rest * settings.b)


def _final_op(model: Process, settings: Settings) -> float:
    """OP that the loop settles at after a unit set-point step [OP]."""
    if model.process == INTEGRATING:
        return 0.0
    return float(_final_value(model, settings, "setpoint") / model.gain)


def _figures(time: Array, pv: Array, op: Array, kind: str, final: float, keep: np.ndarray) -> Response:
    """IAE, overshoot and settling time over the whole window; the curves as far as `keep` says."""
    target = 1.0 if kind == "setpoint" else 0.0
    offset = abs(target - final) > 1e-9
    e = np.abs(target - pv)
    iae = math.inf if offset else float(np.sum(e[1:] + e[:-1]) / 2 * (time[1] - time[0]))
    if kind == "setpoint":
        scale = abs(final) or 1.0
        overshoot = max(0.0, float(pv.max() if final >= 0 else -pv.min()) - abs(final)) / scale
    else:
        peak = float(pv[np.abs(pv).argmax()])
        scale = abs(peak) or 1.0
        overshoot = max(0.0, float((-np.sign(peak) * pv).max())) / scale
    outside = np.flatnonzero(np.abs(pv - final) > SETTLING_SHARE * scale)
    settling_time = float(time[min(outside[-1] + 1, len(time) - 1)]) if outside.size else 0.0
    return Response(time[keep], pv[keep], op[keep], iae, overshoot, settling_time)
