"""What an event says of its loop: the index, and a verdict with its reason in plain words.

A verdict looks at speed (the closed-loop index CI) and at safety (peak sensitivity Ms of the current settings
on the identified model). Where the evidence cannot carry either, it says so instead.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from monitor.contract.loops import Loop, lives_with_offset
from monitor.contract.records import INCONCLUSIVE, Assessment, event_id
from monitor.detect.state import CAUSES, INTERRUPTED, LOAD_STEP, SETPOINT_STEP, SETTLED, STATES
from monitor.identify.direct import correlation_time, fit_kinds, setpoint_integrals
from monitor.identify.fit import INTEGRATING, SELF_REGULATING, Array, Fit, contradictory, decide
from monitor.identify.indirect import REPRODUCES, indirect_fit, reproduces
from monitor.identify.outliers import without_wild

from .reference import (
    LOAD,
    SETPOINT,
    closed_loop_time,
    model_of,
    reduced,
    reference_iae,
    reference_structure,
    settings_of,
)
from .tuning import current_sensitivity, judge

LEAST_COVERAGE = 0.8
"""Share of an event's time that must be covered by good samples."""
MOST_SATURATION = 0.1
"""Share of an event's time that OP may spend at a limit before its response is not used."""
LEAST_FIT = 0.95
"""Share of PV's variance that a model must explain before anything rests on it: 3 % of noise costs about 1 %,
a load step in the middle of the window 10 % and more, and with it the gain is wrong by a factor."""
LEAST_FIT_IN_NOISE = 0.7
"""The same for a small step, where what is left over is no larger than the noise before it."""
LEAST_LOAD_FIT_IN_NOISE = 0.9
"""The same for a load step, whose time and size are fitted too: a wandering load has been explained by 85 %."""
FAR_ABOVE_NOISE = 5.0
"""Standard deviations of PV's noise above which what is left over has a cause of its own: an oscillation, a
neighbour. Then a model must explain more."""
LEAST_FIT_AMONG_OTHERS = 0.98
"""The share of PV's variance that it must explain then: what is left is a seventh of the standard deviation."""
LIKE_NOISE = 1.3
"""Residuals up to this many standard deviations of the error when quiet are noise."""
STANDS_OUT = 6.0
"""Standard deviations of the error when quiet that a step in noise must reach: coloured noise has its own
shapes."""
NOISY = 0.015
"""Residuals, as a share of PV's range, from which the direct fit's bias outweighs the mismatch of the indirect one."""
WIDEST_GAIN = 2.0
"""Ratio of the ends of the gain's 95 % interval above which no verdict and no suggestion rests on it."""
INTEGRALS_AGREE = 0.25
"""Difference in ln gain between fit and integrals that proves nothing: at 3 % of noise it stays below 0.12; a
disturbance of a quarter of the step brings more, and can bend a fit by a factor of two at a quality of 0.98."""
MOST_REST_ERROR = 0.3
"""Error in ln gain from which the integrals are no check: under noise they lose to the drift of OP's rest."""
MANY_UNCERTAIN = 0.2
"""Share of an event's samples of uncertain quality from which that is said beside its figures."""
LEAST_LOAD_FIT = 0.5
"""Share of PV's variance that a load step must explain to be reported as one, where what is left over is small."""
LOAD_REST = 0.12
"""Residuals, as a share of the error's largest excursion, that do not speak against a load step."""
COARSE = 0.5
"""Nor do residuals of half a step of a coarse PV, whose rounding they are."""
LOAD_STANDS_OUT = 9.0
"""Standard deviations of the error's short average when quiet that such a load step must reach."""
LEAST_PERIODS = 4.0
"""Sample periods that the response must last (IAE per unit of step) before its shape is judged."""
RESOLVED = 3.0
"""Sample periods that a self-regulating process's T0 must last (an integrator's slope is seen at any rate)."""
SWINGS, HALFWAY, REGULAR = 4, 0.7, 0.25
"""Cycles in an event from which it is said that PV swings; times its median size, once PV has arrived, that the error
must go to either side to be on the other one; and relative spread of the cycles' lengths, up to 0.06 where a sine
makes them. A wandering load makes 0.08 to 0.75: so nothing is said of the cause."""
TAIL = 4.0
"""Integral times after which an integral action that works has taken away what was left of the error."""


@dataclass(frozen=True, slots=True)
class Finding:
    """One assessed event, with what the loop's own verdict needs of it."""

    record: Assessment
    fit: Fit | None
    usable: bool
    """The fit may carry a suggestion."""
    is_event: bool
    """False for a suspected load step that no step explains: a disturbance of another shape."""
    noise: float
    """Standard deviation of PV's noise before the event [PV]."""
    period: float
    """[s]"""


def assess_event(loop: Loop, event: Any, window: Array) -> Finding:
    """Judge one closed event.

    Parameters
    ----------
    loop
        The loop's row; its settings are those in force during the event.
    event
        Row of dtype `detect.OUT`.
    window
        (n, 4) time [s], SP, PV [PV], OP held [OP].
    """
    load = event["kind"] == LOAD_STEP
    event, window = without_wild(event, window)
    fit, decided = _identify(loop, event, window)
    against = _against(loop, event, window, fit, decided)
    iae = float(event["iae"])
    # figures of a model that does not explain the event would only mislead
    trusted = fit if fit is not None and decided and _explained(fit, event) else None
    ci = None if trusted is None else index(loop, event, trusted)
    model = None if trusted is None else model_of(trusted)
    ms = current_sensitivity(loop, model, float(event["period"]))
    if against:
        verdict, reason = INCONCLUSIVE, "; ".join(against)
    else:
        assert model is not None  # noqa: S101 (what _against makes sure of)
        over = 0.0 if load else overshoot(event, window)
        verdict, reason = judge(loop, model, (None, ci) if load else (ci, None), ms, over)
        reason = "; ".join(filter(None, [reason, _ended(event)]))
    if event["uncertain"] > MANY_UNCERTAIN:
        said = f"{float(event['uncertain']):.0%} of its samples are of uncertain quality"
        reason = "; ".join(filter(None, [reason, said]))
    gain_integrals, t0_integrals = _by_integrals(event, fit)
    onset, amplitude = int(event["onset"]), float(event["amplitude"])
    if load:
        amplitude = (fit.size if fit is not None else None) or 0.0
        onset += round(fit.onset * 1e9) if fit is not None and fit.onset is not None else 0
    record = Assessment(
        loop=loop.name,
        id=event_id(loop.name, int(event["onset"])),
        event=int(event["number"]),
        kind=LOAD if load else SETPOINT,
        start=onset,
        end=int(event["end"]),
        state=STATES[event["state"]],
        amplitude=amplitude,
        iae=iae,
        ci=ci,
        process="undecided" if trusted is None else trusted.process,
        method=None if fit is None else fit.method,
        fit=None if fit is None else fit.quality,
        coverage=coverage(event),
        verdict=verdict,
        reason=reason,
        ms=ms,
        gain_integrals=gain_integrals,
        t0_integrals=t0_integrals,
        **({} if fit is None else model_fields(fit)),
    )
    return Finding(
        record,
        fit,
        usable=fit is not None and not against,
        is_event=not load
        or (fit is not None and _is_load_step(fit, event) and _op_moved(fit, event, window)),
        noise=float(event["noise"]),
        period=float(event["period"]),
    )


def _is_load_step(fit: Fit, event: Any) -> bool:
    """Whether a step of the load explains enough to be reported; a verdict asks for more (`_explained`)."""
    size = abs(float(event["amplitude"]))
    rest = max(LIKE_NOISE * float(event["sd_e"]), LOAD_REST * size, COARSE * float(event["quantum"]))
    stands_out = size > LOAD_STANDS_OUT * math.sqrt(float(event["loop_state"]["var_s"]))
    return fit.quality >= LEAST_FIT or (fit.quality >= LEAST_LOAD_FIT and fit.sigma <= rest and stands_out)


def _op_moved(fit: Fit, event: Any, window: Array) -> bool:
    """Whether OP went from one level to another: the load's size stands out of what OP did when quiet."""
    quiet = window[: max(int(event["before"]) // 2, 2), 3]
    # a process without any dynamics is the controller seen backwards: noise and slow drift look like that
    dynamic = fit.t0 > 0.5 * float(event["period"])
    # an onset at the window's edge lies before it: such a fit knows nothing of the dead time
    dynamic = dynamic and fit.onset is not None and fit.onset > window[0, 0] + float(event["period"])
    return fit.size is not None and abs(fit.size) > 0.5 * float(np.std(quiet)) and dynamic


def _explained(fit: Fit, event: Any) -> bool:
    """Whether the model leaves nothing but noise: by its share of PV's variance, or by the residuals' size."""
    small = abs(float(event["amplitude"])) < STANDS_OUT * float(event["sd_e"])
    like_noise = fit.sigma <= LIKE_NOISE * float(event["sd_e"])
    others = fit.sigma > FAR_ABOVE_NOISE * float(event["noise"])
    if others:
        return fit.quality >= LEAST_FIT_AMONG_OTHERS
    in_noise = LEAST_LOAD_FIT_IN_NOISE if event["kind"] == LOAD_STEP else LEAST_FIT_IN_NOISE
    return fit.quality >= LEAST_FIT or (fit.quality >= in_noise and like_noise and not small)


def model_fields(fit: Fit) -> dict[str, float]:
    """Return the model's columns: ``gain, t0, dead_time, lag``, each with ``_lo`` and ``_hi``.

    A second lag counts half as lag, half as dead time (half rule, Skogestad 2003).
    """
    half = {"lag": fit.lag2 / 2, "dead_time": fit.lag2 / 2}
    fields: dict[str, float] = {}
    for name in ("gain", "t0", "dead_time", "lag"):
        more = half.get(name, 0.0)
        low, high = fit.interval(name)
        fields |= {
            name: float(getattr(fit, name)) + more,
            f"{name}_lo": low + more,
            f"{name}_hi": high + more,
        }
    return fields


def coverage(event: Any) -> float:
    """Share of the event's time with good samples."""
    return min(float(event["good"] / event["wall"]), 1.0) if event["wall"] > 0 else 0.0


def _identify(loop: Loop, event: Any, window: Array) -> tuple[Fit | None, bool]:
    """Fit the kinds of process that the loop may be; return the best and whether the kind is beyond doubt.

    Directly first. A set-point step under much noise is also fitted by simulating the closed loop, where the known
    settings reproduce OP: noise that travels round the loop biases the direct fit, while a wrong order of the
    model costs the simulated loop more. After a load step the simulated loop has false minima and is left out.
    """
    kinds = [INTEGRATING, SELF_REGULATING] if loop.process == "auto" else [loop.process]
    before, span, load = int(event["before"]), float(window[-1, 0]), event["kind"] == LOAD_STEP
    period = float(event["period"])
    direct = fit_kinds(window, before, kinds, load, period)
    best, decided = decide(direct, span)
    settings = settings_of(loop)
    noisy = best is not None and best.sigma >= NOISY * float(np.ptp(window[:, 2]))
    if best is None or load or settings is None or not noisy:
        return best, decided
    if reproduces(window, settings, period) < REPRODUCES:
        return best, decided
    fits = [indirect_fit(window, before, period, settings, f) for f in ([best] if decided else direct)]
    better = [f for f in fits if f is not None and _explained(f, event) and not contradictory([f], best)]
    if not better:
        return best, decided
    chosen, sure = decide(better, span)
    return chosen, decided or (sure and len(better) == len(direct))


def _by_integrals(event: Any, fit: Fit | None) -> tuple[float | None, float | None]:
    """Gain and T0 by the running integrals, where they hold: an integrator, settled, from a quiet start."""
    quiet = STATES[event["state"]] == SETTLED and event["quiet"] and event["kind"] == SETPOINT_STEP
    if fit is None or fit.process != INTEGRATING or not quiet:
        return None, None
    gain, t0 = setpoint_integrals(*(float(event[n]) for n in ("amplitude", "s1", "s2", "y1")))
    return (gain, t0) if math.isfinite(gain) else (None, None)


def _against(  # noqa: C901 (one if for each reason)
    loop: Loop, event: Any, window: Array, fit: Fit | None, decided: bool
) -> list[str]:
    """Say why the evidence cannot carry a verdict; empty where it can."""
    reasons = []
    covered = coverage(event)
    if covered < LEAST_COVERAGE:
        reasons.append(f"only {covered:.0%} of the event is covered by good samples (at least 80 % needed)")
    limited = float(event["saturated"] / event["wall"]) if event["wall"] > 0 else 0.0
    if limited > MOST_SATURATION:
        reasons.append(f"OP was at its limit for {limited:.0%} of the event (10 % allowed)")
    size = abs(float(event["amplitude"]))
    lasted = float(event["iae"] - event["iae_noise"]) / size
    if lasted < LEAST_PERIODS * event["period"]:
        reasons.append(
            f"sampled too coarsely: the response lasts {lasted:.3g} s, the sample period is {event['period']:.3g} s"
        )
    offset = float(event["offset"])
    # a slow tail, as of an integral time longer than the event, is no rest
    time_enough = loop.kp is None or math.isinf(loop.ti) or event["wall"] > TAIL * loop.ti
    at_rest = STATES[event["state"]] == SETTLED and time_enough
    if at_rest and not lives_with_offset(loop) and abs(offset) > max(0.05 * size, 3.0 * event["sd_e"]):
        why = (
            "no integral action"
            if loop.kp is not None and math.isinf(loop.ti)
            else "no integral action, or OP held"
        )
        reasons.append(f"PV came to rest {offset:+.3g} [PV] away from the set point: {why}")
    if fit is None:
        return [*reasons, "no model: OP or PV did not move, or the event is too short"]
    if not decided:
        reasons.append("undecided: an integrating and a self-regulating model fit equally well")
    if not _explained(fit, event):
        why = ", and ".join(filter(None, ["something else moved it", _swinging(window, event)]))
        reasons.append(f"a model explains only {fit.quality:.0%} of PV's movement: {why}")
    if fit.process == SELF_REGULATING and fit.t0 < RESOLVED * event["period"]:
        reasons.append(
            f"sampled too coarsely: T0 = {fit.t0:.3g} s cannot be seen with a sample period of {event['period']:.3g} s"
        )
    if loop.kp is not None and fit.gain * loop.kp < 0:
        reasons.append(
            "the process gain found and the controller gain kp have opposite signs: check the loop table"
        )
    gain, _ = _by_integrals(event, fit)
    if gain is not None and abs(offset) <= 0.05 * size and _disagree(gain, fit, _rest_error(event, window)):
        reasons.append(
            f"the fit's gain is {fit.gain:.3g}, that of the integrals {gain:.3g}: something else moved PV meanwhile"
        )
    low, high = fit.interval("gain")
    if abs(high / low if low * high > 0 and abs(high) > abs(low) else low / high) > WIDEST_GAIN:
        reasons.append(f"the gain is known only to lie in {low:.3g} ... {high:.3g}")
    return reasons


def _rest_error(event: Any, window: Array) -> float:
    """Return the standard deviation in ln gain of the integrals: the error of OP's noisy rest adds up."""
    quiet = window[: max(int(event["before"]), 2), 3]
    independent = len(quiet) / correlation_time(quiet - quiet.mean())
    return abs(float(np.std(quiet)) / math.sqrt(independent) * float(event["wall"]) / float(event["s1"]))


def _disagree(gain: float, fit: Fit, rest_error: float) -> bool:
    """Whether the integrals' gain contradicts the fit's: by sign, or by more than 4 sigma and `INTEGRALS_AGREE`."""
    if rest_error > MOST_REST_ERROR:
        return False  # the integrals say nothing here
    if gain * fit.gain < 0:
        return True
    sigma = math.hypot(math.sqrt(float(fit.cov[0, 0])), rest_error)
    return abs(math.log(gain / fit.gain)) > max(4.0 * sigma, INTEGRALS_AGREE)


def _swinging(window: Array, event: Any) -> str | None:
    """Say how PV swings about the set point after it has first come there; None where it does not, or in noise."""
    t, e = window[int(event["before"]) :, 0], (window[:, 1] - window[:, 2])[int(event["before"]) :]
    arrived = int(np.argmax(e * e[0] < 0.0)) if len(e) else 0
    e = e[arrived:] - np.median(e[arrived:]) if arrived > 0 else e[:0]
    size = float(np.median(np.abs(e))) if len(e) else 0.0
    if size < 2.0 * event["noise"] or size == 0.0:
        return None
    side = np.where(np.abs(e) > HALFWAY * size, np.sign(e), 0.0)
    turns = np.flatnonzero(side)[1:][np.diff(side[side != 0.0]) > 0.0] if np.any(side) else np.array([])
    if len(turns) < SWINGS:
        return None
    cycles = np.diff(t[arrived:][turns])
    cycle = float(np.mean(cycles))
    if np.std(cycles) > REGULAR * cycle:
        return None
    return f"it swings about the set point, about every {cycle:.3g} s"


def _ended(event: Any) -> str:
    """Say how the event ended, where that limits what it says."""
    if STATES[event["state"]] == INTERRUPTED:
        return f"the event was cut short by {CAUSES[event['cause']]}"
    return "" if STATES[event["state"]] == SETTLED else "the loop did not settle"


def index(loop: Loop, event: Any, fit: Fit) -> float | None:
    """CI_sp or CI_ld: the reference's IAE over the measured one (its noise's share taken off); None where none applies.

    Of an event that was cut short the IAE is a lower bound, so CI is an upper one. It is given where the error
    had died down to a tenth of the step, and where even the bound is too low.
    """
    model = model_of(fit)
    structure = reference_structure(loop)
    tc = closed_loop_time(loop, reduced(model, structure), float(event["period"]))
    try:
        kind, size = (SETPOINT, float(event["amplitude"])) if fit.size is None else (LOAD, fit.size)
        best = reference_iae(kind, size, model, structure, tc, loop.b, loop.c)
    except ValueError:
        return None
    iae = float(event["iae"] - event["iae_noise"])
    if not math.isfinite(best) or iae <= 0:
        return None
    still_far = abs(float(event["offset"])) > 0.1 * abs(float(event["amplitude"]))
    if STATES[event["state"]] != SETTLED and still_far and best / iae >= loop.ci_min:
        return None
    return best / iae


def overshoot(event: Any, window: Array) -> float:
    """How far PV went beyond the new set point, as a share of the step."""
    after = window[int(event["before"]) :]
    size = float(event["amplitude"])
    return max(float(np.max((after[:, 2] - after[:, 1]) / size)), 0.0) if len(after) else 0.0
