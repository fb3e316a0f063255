"""What speaks against an event: for each doubt one test, with its reason in words."""

from __future__ import annotations

import math

import numpy as np

from monitor.contract.loops import Loop, offset_intended
from monitor.contract.text import duration
from monitor.detect.event import INTERRUPTED, LOAD_STEP, SETPOINT_RAMP, SETPOINT_STEP, SETTLED, ClosedEvent
from monitor.identify.correlation import correlation_time
from monitor.identify.fit import Fit
from monitor.identify.integrals import setpoint_integrals
from tuners.models import INTEGRATING, SELF_REGULATING

from .damping import SWING_FLOOR_SD
from .index import beats_dead_time, overshoot

LEAST_EVENT_COVERAGE = 0.8
"""Share of an event's time that must be covered by good samples."""
MOST_SATURATED_SHARE = 0.1
"""Share of an event's time that OP may spend at a limit before its error is no measure of the tuning. The model stays:
the process saw OP as it was recorded."""
MOST_SATURATED_LOAD_SHARE = 0.3
"""The same for a load step, from which on the model is not used either: while OP rests, a load's size and the process's
gain are one number."""
WOUND_UP_SHARE = 0.1
"""Of the time at a limit that OP may stay there although the error asks it away: noise and a sample or two."""
LEAST_FIT = 0.95
"""Share of PV's variance that a model must explain before anything rests on it: 3 % of noise costs about 1 %,
a load step in the middle of the window 10 % and more, and with it the gain is wrong by a factor."""
LEAST_NOISY_FIT = 0.7
"""The same for a small step, where what is left over is no larger than the noise before it."""
LEAST_NOISY_LOAD_FIT = 0.9
"""The same for a load step, whose time and size are fitted too: a wandering load has been explained by 85 %."""
FAR_ABOVE_NOISE_SD = 5.0
"""Standard deviations of PV's noise above which what is left over has a cause of its own: an oscillation, a
neighbour. Then a model must explain more."""
LEAST_DISTURBED_FIT = 0.98
"""The share of PV's variance that it must explain then: what is left is a seventh of the standard deviation."""
LIKE_NOISE_SD = 1.3
"""Residuals up to this many standard deviations of the error when quiet are noise."""
UNLIKE_NOISE_SD = 2.0
"""Residuals above so many standard deviations of the error when quiet are no noise: a loop near instability, which
amplifies it, leaves 1.5 after a true step."""
STANDS_OUT_SD = 6.0
"""Standard deviations of the error when quiet that a step in noise must reach: coloured noise has its own
shapes."""
NOISY_RANGE_SHARE = 0.015
"""Residuals, as a share of PV's range, from which the direct fit's bias outweighs the mismatch of the indirect one."""
WIDEST_GAIN_RATIO = 2.0
"""Ratio of the ends of the gain's 95 % interval above which no verdict and no suggestion rests on it."""
WIDEST_DEAD_TIME_RATIO = 1.8
"""Likewise of the dead time's interval after a ramp: the slower it is, the less PV's lag behind OP stands out of the
noise, and Ms and the reference's error go with the dead time and its square."""
WIDE_GAIN = "the gain is known only to lie in"
"""How it begins to be said that the interval is too wide."""
INTEGRALS_AGREE_LN = 0.25
"""Difference in ln gain between fit and integrals that proves nothing: at 3 % of noise it stays below 0.12; a
disturbance of a quarter of the step brings more, and can bend a fit by a factor of two at a quality of 0.98."""
MOST_REST_ERROR_LN = 0.3
"""Error in ln gain from which the integrals are no check: under noise they lose to the drift of OP's rest."""
MOST_REST_SHARE = 0.1
"""Of the step, and of OP's integral, by which the rest that the integrals count from may be off."""
MOST_OVERSHOOT = 2.0
"""Times the step that PV may go beyond the set point: a loop at the edge of instability goes one step beyond."""
MANY_UNCERTAIN_SHARE = 0.2
"""Share of an event's samples of uncertain quality from which that is said beside its figures."""
LEAST_LOAD_FIT = 0.5
"""Share of PV's variance that a load step must explain to be reported as one, where what is left over is small."""
LOAD_REST_SHARE = 0.12
"""Residuals, as a share of the error's largest excursion, that do not speak against a load step."""
ROUNDING_QUANTA = 0.5
"""Nor do residuals of half a step of a coarse PV, whose rounding they are."""
BACK_SHARE, AT_REST_SHARE, NOT_TAKEN_SHARE = 0.2, 0.15, 0.3
"""Share of the excursion within which PV is back; share of the event's end for which OP has come to rest (an event is
at rest for its last third); share of a load that OP may not have taken over then: true steps leave up to 0.07."""
REPORTED_LOAD_SD = 9.0
"""Standard deviations of the error's short average when quiet that such a load step must reach."""
LEAST_ANSWER_SHARE = 0.05
"""Share of a load's size that OP must have answered."""
LEAST_RESPONSE_PERIODS = 4.0
"""Sample periods that the response must last (IAE per unit of step) before its shape is judged."""
LEAST_T0_PERIODS = 3.0
"""Sample periods that a self-regulating process's T0 must last (an integrator's slope is seen at any rate)."""
LEAST_SWINGS, SWING_SHARE, REGULAR_SHARE = 4, 0.7, 0.25
"""Cycles in an event from which it is said that PV swings; times its median size, once PV has arrived, that the error
must go to either side to be on the other one; and relative spread of the cycles' lengths, up to 0.06 where a sine
makes them. A wandering load makes 0.08 to 0.75: so nothing is said of the cause."""
TAIL_INTEGRAL_TIMES = 4.0
"""Integral times after which an integral action that works has taken away what was left of the error."""


def is_load_step(fit: Fit, event: ClosedEvent) -> bool:
    """Whether a step of the load explains enough to be reported; a verdict asks for more (`is_explained`)."""
    size = abs(event.amplitude)
    noise = max(UNLIKE_NOISE_SD * event.error_sd, ROUNDING_QUANTA * event.quantum)
    if fit.leaves_more and fit.sigma > noise and not is_explained(fit, event):
        return False
    rest = max(LIKE_NOISE_SD * event.error_sd, LOAD_REST_SHARE * size, ROUNDING_QUANTA * event.quantum)
    stands_out = size > REPORTED_LOAD_SD * event.short_sd
    explains = fit.quality >= LEAST_FIT or (
        fit.quality >= LEAST_LOAD_FIT and fit.sigma <= rest and stands_out
    )
    return explains and taken_over(fit, event)


def taken_over(fit: Fit, event: ClosedEvent) -> bool:
    """Whether OP bears the load found, where PV has come back to rest (derived; true of any process and controller).

    A process at rest where it was has the input that it had: OP has moved by as much as the load, the other way. After
    a pulse, several steps or a load behind the process it has not.
    """
    back = event.state == SETTLED and abs(event.offset) <= BACK_SHARE * abs(event.amplitude)
    if not back or event.saturated_time > 0.0 or fit.size is None:
        return True
    op, quiet = event.window.op, max(event.window.before // 2, 2)
    rest = op[-max(round(AT_REST_SHARE * (len(op) - event.window.before)), 2) :]
    by_chance = 3.0 * float(np.std(op[:quiet])) * math.sqrt(1.0 / quiet + 1.0 / len(rest))
    moved = float(np.mean(rest) - np.mean(op[:quiet]))
    return abs(moved + fit.size) <= max(NOT_TAKEN_SHARE * abs(fit.size), by_chance)


def op_moved(fit: Fit, event: ClosedEvent) -> bool:
    """Whether OP went from one level to another: the load's size stands out of what OP did when quiet.

    And OP has begun to answer it: what did not move OP says nothing of what OP does.
    """
    quiet = event.window.op[: max(event.window.before // 2, 2)]
    # a process without any dynamics is the controller seen backwards: noise and slow drift look like that
    dynamic = fit.t0 > 0.5 * event.period
    # an onset at the window's edge lies before it: such a fit knows nothing of the dead time
    dynamic = dynamic and fit.onset is not None and fit.onset > event.window.time[0] + event.period
    answered = float(np.max(np.abs(event.window.op - np.mean(quiet))))
    size = abs(fit.size or 0.0)
    return dynamic and 0.5 * float(np.std(quiet)) < size < answered / LEAST_ANSWER_SHARE


def is_explained(fit: Fit, event: ClosedEvent) -> bool:
    """Whether the model leaves nothing but noise: by its share of PV's variance, or by the residuals' size."""
    small = is_small(event)
    if fit.wander is not None:
        return not (small or fit.leaves_more or swinging(event))  # what swings is no wandering load
    like_noise = fit.sigma <= LIKE_NOISE_SD * event.error_sd
    others = fit.sigma > FAR_ABOVE_NOISE_SD * event.noise
    if others:
        return fit.quality >= LEAST_DISTURBED_FIT
    in_noise = LEAST_NOISY_LOAD_FIT if event.kind == LOAD_STEP else LEAST_NOISY_FIT
    return fit.quality >= LEAST_FIT or (fit.quality >= in_noise and like_noise and not small)


def is_small(event: ClosedEvent) -> bool:
    """Whether a step does not stand out of what the error does when quiet."""
    return abs(event.amplitude) < STANDS_OUT_SD * event.error_sd


def is_wide(fit: Fit) -> bool:
    """Whether the gain is known too roughly for anything to rest on it."""
    low, high = fit.interval("gain")
    ratio = high / low if low * high > 0 and abs(high) > abs(low) else low / high if high else math.inf
    return abs(ratio) > WIDEST_GAIN_RATIO


def coverage(event: ClosedEvent) -> float:
    """Share of the event's time with good samples."""
    return min(event.good_time / event.duration, 1.0) if event.duration > 0 else 0.0


def by_integrals(event: ClosedEvent, fit: Fit | None) -> tuple[float | None, float | None]:
    """Gain and T0 by the running integrals, where they hold: an integrator, settled, from a quiet start."""
    quiet = event.state == SETTLED and event.quiet and event.kind == SETPOINT_STEP
    if fit is None or fit.process != INTEGRATING or not quiet or fit.other is not None:
        return None, None
    if not _began_at_rest(event):
        return None, None
    gain, t0 = setpoint_integrals(event.amplitude, event.s1, event.s2, event.y1)
    return (gain, t0) if math.isfinite(gain) else (None, None)


def _began_at_rest(event: ClosedEvent) -> bool:
    """Whether the integrals count from where PV and OP were just before: else an upset is in the mean that they use."""
    w, m = event.window, max(event.window.before, 1)
    of_pv = abs(event.pv0 - float(np.mean(w.pv[:m]))) / abs(event.amplitude)
    of_op = abs(event.op0 - float(np.mean(w.op[:m]))) * event.duration / max(abs(event.s1), 1e-300)
    return max(of_pv, of_op) <= MOST_REST_SHARE


def evidence_against(loop: Loop, event: ClosedEvent, fit: Fit | None, decided: bool) -> list[str]:
    """Say why the evidence cannot carry a verdict; empty where it can."""
    reasons = _against_samples(loop, event)
    if fit is None:
        return [*reasons, "no model: OP or PV did not move, or the event is too short"]
    return reasons + _against_fit(loop, event, fit, decided)


def at_limit(event: ClosedEvent) -> str:
    """Say why an event with OP at a limit gives no index; empty where it does.

    The error is the limit's then, not the tuning's. What the process did with the OP that it got is as true as ever.
    """
    limited = saturated_share(event)
    return (
        f"OP was at its limit for {limited:.0%} of the event: no index"
        if limited > MOST_SATURATED_SHARE
        else ""
    )


def saturated_share(event: ClosedEvent) -> float:
    """Share of an event's time that OP spent at a limit."""
    return event.saturated_time / event.duration if event.duration > 0 else 0.0


def wound_up(loop: Loop, event: ClosedEvent) -> float:
    """Return how long OP stood at a limit though PV was clearly beyond the set point, so that the error asked it away.

    An integral that stands still at the limit lets OP leave it before PV arrives; one that goes on has to be unwound
    first, and that is no matter of a linear model [s].
    """
    if loop.kp is None:
        return 0.0  # which way the error asks is not known
    w, clear = event.window, SWING_FLOOR_SD * event.error_sd
    wants = math.copysign(1.0, loop.kp) * (w.sp - w.pv)[w.before : -1]
    op, held = w.op[w.before : -1], np.diff(w.time[w.before :])
    low = -math.inf if loop.op_low is None else loop.op_low
    high = math.inf if loop.op_high is None else loop.op_high
    against = ((op >= high) & (wants < -clear)) | ((op <= low) & (wants > clear))
    return float(np.sum(held[against]))


def _against_samples(loop: Loop, event: ClosedEvent) -> list[str]:
    """Say what is wrong with the event as it was measured."""
    reasons = []
    covered = coverage(event)
    if covered < LEAST_EVENT_COVERAGE:
        reasons.append(f"only {covered:.0%} of the event is covered by good samples (at least 80 % needed)")
    if event.kind == LOAD_STEP and saturated_share(event) > MOST_SATURATED_LOAD_SHARE:
        reasons.append(f"{at_limit(event)}, and nothing tells the load from the process meanwhile")
    elif at_limit(event) and (wound := wound_up(loop, event)) > WOUND_UP_SHARE * event.saturated_time:
        reasons.append(
            f"{at_limit(event)}; it stayed there for {duration(wound)} after PV had passed the set point: the integral "
            "action winds up"
        )
    size = abs(event.amplitude)
    lasted = (event.iae - event.iae_noise) / size if size > 0.0 else 0.0
    if event.kind != SETPOINT_RAMP and lasted < LEAST_RESPONSE_PERIODS * event.period:
        reasons.append(
            f"sampled too coarsely: the response lasts {duration(lasted)}, a sample period {duration(event.period)}"
        )
    beyond = overshoot(event) if event.kind == SETPOINT_STEP else 0.0
    if beyond > MOST_OVERSHOOT and beyond * size > STANDS_OUT_SD * event.error_sd:
        reasons.append(f"PV went {beyond:.3g} times the step beyond the set point: something else moved it")
    offset = event.offset
    # a slow tail, as of an integral time longer than the event, is no rest
    time_enough = loop.kp is None or math.isinf(loop.ti) or event.duration > TAIL_INTEGRAL_TIMES * loop.ti
    at_rest = event.state == SETTLED and time_enough
    if at_rest and not offset_intended(loop) and abs(offset) > max(0.05 * size, 3.0 * event.error_sd):
        none = loop.kp is not None and math.isinf(loop.ti)
        why = "no integral action" if none else "no integral action, or OP held"
        reasons.append(f"PV came to rest {offset:+.3g} [PV] away from the set point: {why}")
    return reasons


def _against_fit(loop: Loop, event: ClosedEvent, fit: Fit, decided: bool) -> list[str]:
    """Say why no verdict rests on the model."""
    reasons = []
    if not decided:
        reasons.append("undecided: an integrating and a self-regulating model fit equally well")
    if not is_explained(fit, event):
        reasons.append(_unexplained(fit, event))
    elif fit.other is not None and fit.size is None and (swings := swinging(event)):
        reasons.append(f"a load beside the step would explain PV's movement, but {swings}")
    if fit.process == SELF_REGULATING and fit.t0 < LEAST_T0_PERIODS * event.period:
        reasons.append(
            f"sampled too coarsely: T0 = {fit.t0:.3g} s cannot be seen with a sample period of {event.period:.3g} s"
        )
    if beats_dead_time(event, fit):
        reasons.append(
            f"PV came back faster than any feedback brings it over the dead time found "
            f"({fit.interval('dead_time')[0]:.3g} s at least): the model is wrong, or OP was moved ahead"
        )
    if loop.kp is not None and fit.gain * loop.kp < 0:
        # a loop that holds PV has the right sign; only a model beyond doubt says that the table has not
        sure = (
            not reasons
            and event.kind != LOAD_STEP
            and not is_wide(fit)
            and fit.quality >= LEAST_DISTURBED_FIT
        )
        reasons.append(
            "the process gain found and the controller gain kp have opposite signs: check the loop table"
            if sure
            else "the gain found has the wrong sign for a loop that holds PV: something else moved it"
        )
    gain, _ = by_integrals(event, fit)
    small = abs(event.offset) <= 0.05 * abs(event.amplitude)
    if gain is not None and small and disagrees(gain, fit, _rest_error(event)):
        reasons.append(
            f"the fit's gain is {fit.gain:.3g}, that of the integrals {gain:.3g}: something else moved PV meanwhile"
        )
    least, most = fit.interval("dead_time")
    if event.kind == SETPOINT_RAMP and most > WIDEST_DEAD_TIME_RATIO * least:
        reasons.append(
            f"so slow a move does not show how fast the process answers (dead time in {least:.3g} ... {most:.3g} s)"
        )
    low, high = fit.interval("gain")
    if is_wide(fit):
        reasons.append(f"{WIDE_GAIN} {low:.3g} ... {high:.3g}")
    return reasons


def _unexplained(fit: Fit, event: ClosedEvent) -> str:
    """Say why a model does not explain an event."""
    if fit.wander is not None and is_small(event):
        return (
            f"the step of {event.amplitude:.3g} [PV] does not stand out of the error that loads leave all the time "
            f"({event.error_sd:.2g} [PV])"
        )
    why = ", and ".join(filter(None, ["something else moved it", swinging(event)]))
    return f"a model explains only {fit.quality:.0%} of PV's movement: {why}"


def _rest_error(event: ClosedEvent) -> float:
    """Return the standard deviation in ln gain of the integrals: the error of OP's noisy rest adds up."""
    quiet = event.window.op[: max(event.window.before, 2)]
    independent = len(quiet) / correlation_time(quiet - quiet.mean())
    return abs(float(np.std(quiet)) / math.sqrt(independent) * event.duration / event.s1)


def disagrees(gain: float, fit: Fit, rest_error: float) -> bool:
    """Whether the integrals' gain contradicts the fit's: by sign, or by more than 4 sigma and `INTEGRALS_AGREE_LN`."""
    if rest_error > MOST_REST_ERROR_LN:
        return False  # the integrals say nothing here
    if gain * fit.gain < 0:
        return True
    sigma = math.hypot(math.sqrt(float(fit.cov[0, 0])), rest_error)
    return abs(math.log(gain / fit.gain)) > max(4.0 * sigma, INTEGRALS_AGREE_LN)


def swinging(event: ClosedEvent) -> str | None:
    """Say how PV swings about the set point after it has first come there; None where it does not, or in noise."""
    w = event.window
    t, e = w.time[w.before :], (w.sp - w.pv)[w.before :]
    arrived = int(np.argmax(e * e[0] < 0.0)) if len(e) else 0
    e = e[arrived:] - np.median(e[arrived:]) if arrived > 0 else e[:0]
    size = float(np.median(np.abs(e))) if len(e) else 0.0
    if size < 2.0 * event.noise or size == 0.0:
        return None
    side = np.where(np.abs(e) > SWING_SHARE * size, np.sign(e), 0.0)
    turns = np.flatnonzero(side)[1:][np.diff(side[side != 0.0]) > 0.0] if np.any(side) else np.array([])
    if len(turns) < LEAST_SWINGS:
        return None
    cycles = np.diff(t[arrived:][turns])
    cycle = float(np.mean(cycles))
    if np.std(cycles) > REGULAR_SHARE * cycle:
        return None
    return f"it swings about the set point, about every {duration(cycle)}"


def how_it_ended(event: ClosedEvent) -> str:
    """Say how the event ended, where that limits what it says."""
    if event.state == INTERRUPTED:
        return f"the event was cut short by {event.cause}"
    return "" if event.state == SETTLED else "the loop did not settle"
