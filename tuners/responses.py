"""Closed-loop responses to unit steps, with exact dead time, from the frequency response.

A stable loop that settles within a half period answers a square wave with its step response in each half.
A square wave has odd harmonics only, so that one inverse Fourier transform gives the whole response:
no time stepping, no approximation of the dead time, and stiff loops cost what others cost.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from tuners.models import Array, ComplexArray, Process, SelfRegulatingModel
from tuners.settings import Settings

MIN_POINTS, MAX_POINTS = 1 << 11, 1 << 17
SETTLED = 1e-4  # share of the step that may be left at the end of the window; above, the window doubles
BAND = 0.02  # the usual 2 % band of the settling time


@dataclass(frozen=True, slots=True)
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
    """
    from tuners.robustness import peak_sensitivity  # noqa: PLC0415  (robustness offers this function too)

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
    window = _first_window(model, settings)
    if duration is not None:
        window = max(window, 1.01 * duration)
    for _ in range(12):
        time, pv, op = _square_wave(model, settings, kind, window)
        final = _final_value(model, settings, kind)
        scale = max(1.0 if kind == "setpoint" else 0.0, float(np.abs(pv).max()))
        # The last samples feel the next flank: a cut series rings a little ahead of a kink.
        if np.abs(pv[-len(pv) // 10 : -len(pv) // 50] - final).max() < SETTLED * scale:
            break
        window *= 2
    pv[time <= float(model.dead_time)] = 0.0  # causality, where the cut series rings a little
    keep = time <= (duration if duration is not None else 0.98 * window)
    return _figures(time, pv, op, kind, final, keep)


def _proper(model: Process, settings: Settings) -> tuple[Process, Settings]:
    """Give an improper loop the smallest roll-off that keeps its response finite."""
    if settings.td != 0 and settings.tf == 0 and settings.c != 0:
        settings = replace(settings, tf=settings.td / 1000)
    if model.process == "self-regulating" and not any(float(lag) > 0 for lag in model.lags):
        model = SelfRegulatingModel(model.gain, model.dead_time, model.dead_time / 1000)
    return model, settings


def _first_window(model: Process, settings: Settings) -> float:
    """Nine times the slowest time constant of the loop with its dead time as a first-order Padé [s]."""
    feedback, half = settings, float(model.dead_time) / 2
    kp, ti, td, tf = (float(x) for x in (feedback.kp, feedback.ti, feedback.td, feedback.filter_time))
    reset = 0.0 if math.isinf(ti) else 1 / ti
    if feedback.form == "series":
        controller = kp * np.polymul([1.0, reset], [td, 1.0])
    else:
        controller = kp * np.polyadd(np.polymul([1.0, reset], [tf, 1.0]), [td, 0.0, 0.0])
    poles = np.polymul([1.0, 0.0] if reset else [1.0], [tf, 1.0])
    controller = controller if reset else controller[:-1]
    for lag in model.lags:
        poles = np.polymul(poles, [float(lag), 1.0])
    if model.process == "integrating":
        poles = np.polymul(poles, [1.0, 0.0])
    closed = np.polyadd(
        np.polymul(poles, [half, 1.0]), float(model.gain) * np.polymul(controller, [-half, 1.0])
    )
    roots = np.roots(np.trim_zeros(closed, "f"))
    slowest = np.abs(roots.real).min() if roots.size else 0.0
    shortest = 20 * float(model.t0) + 10 * td
    return max(shortest, 9 / slowest if slowest > 0 else 0.0) or 1.0


def _loop_speed(model: Process, settings: Settings, window: float) -> float:
    """Highest frequency at which abs(L) is above 1 [rad/s], within the window's reach."""
    omega = np.geomspace(1 / window, 1e6 / window, 400)
    above = np.abs(model.frequency_response(omega) * settings.frequency_response(omega)) > 1
    return float(omega[above][-1]) if above.any() else 1 / window


def _points(model: Process, settings: Settings, window: float) -> int:
    """Odd harmonics for a window: 33 samples a radian of the highest crossover, as far as the cap allows."""
    step = 0.03 / _loop_speed(model, settings, window)
    wanted = 2.0 ** math.ceil(math.log2(max(window / step, 1.0)))
    return int(min(max(wanted, MIN_POINTS), MAX_POINTS))


def _square_wave(model: Process, settings: Settings, kind: str, window: float) -> tuple[Array, Array, Array]:
    """Time [s], PV and OP of one half period."""
    count = _points(model, settings, window)
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


def _rest(model: Process, settings: Settings) -> float:
    """Return the final complementary sensitivity: 1 with integral action or an integrator [-]."""
    if math.isfinite(settings.ti) or model.process == "integrating":
        return 1.0
    gain = float(model.gain * settings.kp)
    return gain / (1 + gain)


def _final_value(model: Process, settings: Settings, kind: str) -> float:
    """PV that the loop settles at [PV]."""
    rest = _rest(model, settings)
    if kind == "load":
        return 0.0 if math.isfinite(settings.ti) else rest / float(settings.kp or math.nan)
    return rest if math.isfinite(settings.ti) else rest * float(settings.b)


def _final_op(model: Process, settings: Settings) -> float:
    """OP that the loop settles at after a unit set-point step [OP]."""
    if model.process == "integrating":
        return 0.0
    return _final_value(model, settings, "setpoint") / float(model.gain)


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
    outside = np.flatnonzero(np.abs(pv - final) > BAND * scale)
    settling_time = float(time[min(outside[-1] + 1, len(time) - 1)]) if outside.size else 0.0
    return Response(time[keep], pv[keep], op[keep], iae, overshoot, settling_time)
