"""What an event says of its loop: the index, and a verdict with its reason in plain words.

A verdict looks at speed (the closed-loop index CI) and at safety (peak sensitivity Ms of the current settings
on the identified model). Where the evidence cannot carry either, it says so instead.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import msgspec
import numpy as np

from monitor.by_size import quantile
from monitor.contract.loops import Loop
from monitor.contract.records import GOOD, INCONCLUSIVE, LOAD, SETPOINT, UNDECIDED, Assessment, event_id
from monitor.contract.text import duration
from monitor.detect.event import (
    BY_MOVING,
    CAUSES,
    LOAD_STEP,
    MEAN_ABS_SD,
    SETPOINT_RAMP,
    SETPOINT_STEP,
    ClosedEvent,
)
from monitor.identify.fit import Fit
from monitor.identify.misfit import ModelError, model_error
from monitor.identify.outliers import without_outliers
from monitor.identify.tail import is_tail
from monitor.identify.working_setpoint import working_setpoint
from tuners.models import Model

from .damping import is_damped
from .doubt import gain_doubt
from .evidence import (
    MANY_UNCERTAIN_SHARE,
    WIDE_GAIN,
    at_limit,
    by_integrals,
    coverage,
    evidence_against,
    how_it_ended,
    is_explained,
    is_load_step,
    op_moved,
)
from .index import came_off_rest, drowns, index, overshoot
from .predicted import NO_INDICES, Indices
from .process import Shown, model_of_event, rivals
from .reference import model_of, settings_of
from .tuning import current_sensitivity, indices_to_come, judge

TAIL_PERIODS = 4000.0
"""Sample periods since a loop began, up to which what looks like a load is held against the tail of what was before."""
SURE_RATIO = 1.5
"""Of ``ci_min`` in a predicted index, up to which the model's error is looked at: a later event may bring it below."""
RECONSTRUCTED_SHARE = 0.5
"""Share of PV's values that a historian left out or made up, from which the intervals are wider."""
RECONSTRUCTED_FLOOR_RATIO = 4.0
"""What the variances of a model's mismatch grow by then. What was drawn between two values that were kept, or held,
follows no process: its error is neither noise nor the same at all times, and the residuals show a part of it only
(measured on simulated fleets: without it, one true gain in ten lies outside of the interval)."""
OFF_REST = "no index: PV was not at its set point when the load came"
DROWNED = "no index: loads that wander leave as much error all the time, and its settings are not known"
LOAD_BESIDE = "no index: a load came beside the set-point step, and the error is that one's, too"


Range = tuple[float, float]
"""From, to."""


@dataclass(frozen=True, slots=True)
class Finding:
    """One assessed event, with what the loop's own verdict needs of it."""

    record: Assessment
    fit: Fit | None
    usable: bool
    """The fit may carry a suggestion."""
    wide: bool
    """Nothing but a wide interval speaks against it: beside others that are usable it is, too."""
    is_event: bool
    """False for a suspected load step that no step explains: a disturbance of another shape."""
    noise: float
    """Standard deviation of PV's noise before the event [PV]."""
    period: float
    """[s]"""
    at_limit: bool = False
    """OP was at its limit for so long that there is no index."""
    damped: bool | None = None
    """Whether the response shows that it is well damped; None where it shows nothing of it."""
    predicted: Indices = NO_INDICES
    """Of its own model, where its verdict hangs on them."""
    rivals: tuple[Fit, ...] = ()
    """Models of the other kind of process that the event does not exclude; looked for where settings may follow."""
    misfit: ModelError | None = None
    """The error of the model that the event shows, likewise."""
    error: float = 0.0
    """Integrated absolute error, the noise's share taken off [PV s]."""
    is_tail: bool = False
    """Nothing happened: a suspected load that began before the data, a gap or automatic did."""
    stepped: bool = True
    """Set point or load stepped: the reference's error is known for any model."""
    levels: tuple[Range, Range] = ((0.0, 0.0), (0.0, 0.0))
    """Between which values OP [OP], and PV [PV], were for most of the time after the onset."""

    @property
    def swing(self) -> float:
        """Standard deviation of PV in the event's window [PV]; 0 without a model."""
        if self.fit is None:
            return 0.0
        return self.fit.sigma / math.sqrt(max(1.0 - self.fit.quality, 1e-12))


@dataclass(frozen=True, slots=True)
class Figures:
    """What a verdict on one event rests on."""

    ci: float | None
    """Measured."""
    ms: float | None
    predicted: Indices
    """CI_sp and CI_ld by the settings of today on the event's model, where the event lets them speak."""
    damped: bool | None

    def far_above(self, least: float) -> bool:
        """Whether all indices predicted lie so far above ``least`` that another event's model leaves them there."""
        return all(ci is None or ci > SURE_RATIO * least for ci in self.predicted)


def assess_event(
    loop: Loop,
    event: ClosedEvent,
    extra_delay: float = 0.0,
    contradiction: str = "",
    *,
    thorough: bool = False,
    reconstructed: float = 0.0,
) -> Finding:
    """Judge one closed event.

    Parameters
    ----------
    loop
        With the settings in force during the event.
    extra_delay
        Dead time that the controller adds to the process [s].
    contradiction
        In what the data contradict the settings; then there is no Ms and no verdict.
    thorough
        A retune is under way: the other kind of process and the model's error count even where the loop is good.
    reconstructed
        Share of PV's values that a historian left out or made up, so far.
    """
    load = event.kind == LOAD_STEP
    event, ramped = as_worked_with(loop, without_outliers(event), contradiction)
    shown = model_of_event(loop, event)
    fit = None if shown.fit is None else _widened(replace(shown.fit, extra_delay=extra_delay), reconstructed)
    shown, decided = shown._replace(fit=fit), shown.decided
    tail = load and _is_tail(event, fit)
    against = evidence_against(loop, event, fit, decided)
    # figures of a model that does not explain the event would only mislead
    trusted = fit if fit is not None and decided and is_explained(fit, event) else None
    limited = at_limit(event)
    doubts = [*against, contradiction] if contradiction else against
    model = None if trusted is None else model_of(trusted)
    figures = _figures(loop, event, None if limited else trusted, model, known=not contradiction)
    verdict, reason = _said(loop, event, model, figures, doubts)
    if verdict == INCONCLUSIVE and figures.ci is None and not (limited or doubts):
        reason = _why_no_index(event, trusted) or reason
    said = verdict, "; ".join(filter(None, [shown.contradiction, ramped, reason]))
    finding = Finding(
        _record(loop, event, (fit, trusted), figures, said),
        fit,
        usable=fit is not None and not against,
        wide=fit is not None and len(against) == 1 and against[0].startswith(WIDE_GAIN),
        is_event=not tail and (not load or _stepped(event, fit)),
        is_tail=tail,
        noise=event.noise,
        period=event.period,
        error=event.iae - event.iae_noise,
        stepped=event.kind != SETPOINT_RAMP,
        levels=_levels(event),
        at_limit=bool(limited),
        damped=figures.damped,
        predicted=figures.predicted,
    )
    thorough = thorough or verdict != GOOD or not figures.far_above(loop.ci_min)
    return _doubted(finding, event, shown, thorough=thorough)


def _figures(loop: Loop, event: ClosedEvent, of: Fit | None, model: Model | None, *, known: bool) -> Figures:
    """Return the figures of a verdict: the index by the fit ``of`` it, and Ms where the settings are ``known``."""
    ci = None if of is None else index(loop, event, of)
    ms = current_sensitivity(loop, model, event.period) if known else None
    drowned = of is not None and drowns(event, of)
    return Figures(ci, ms, _predicted(loop, event, model, ci, ms, drowned=drowned), is_damped(event))


def _levels(event: ClosedEvent) -> tuple[Range, Range]:
    """Return between which values OP and PV were for most of the time, and where they came from."""
    op, pv = (values[event.window.before :] for values in (event.window.op, event.window.pv))
    ends = ((*quantile(values, 0.1, 0.9), values[0]) for values in (op, pv))
    return tuple((float(min(each)), float(max(each))) for each in ends)  # type: ignore[return-value]


def _doubted(finding: Finding, event: ClosedEvent, shown: Shown, *, thorough: bool) -> Finding:
    """Return a finding with its model's error and, where that is asked for, the models that its event does not exclude.

    Its record tells intervals where the model is one to rest on, and of the gain with what another process or load may
    do to it.
    """
    fit = finding.fit
    if fit is None or not (finding.is_event and (finding.usable or finding.wide)):
        return finding
    error = model_error(event.window, fit, event.noise)
    others = rivals(event, shown) if thorough else ()
    fit = replace(fit, doubt=gain_doubt(fit, error, event.kind == LOAD_STEP, bool(others)))
    record = msgspec.structs.replace(finding.record, **model_fields(fit))
    return replace(finding, fit=fit, record=record, rivals=others, misfit=error)


def _stepped(event: ClosedEvent, fit: Fit | None) -> bool:
    """Whether a suspected load has proved to be a step."""
    return fit is not None and is_load_step(fit, event) and op_moved(fit, event)


def _is_tail(event: ClosedEvent, fit: Fit | None) -> bool:
    """Whether a suspected load is the tail of what was before the loop began."""
    fresh = event.since_start < TAIL_PERIODS * event.period
    return fresh and is_tail(event.window, fit, event.period)


def _why_no_index(event: ClosedEvent, fit: Fit | None) -> str:
    """Say what else is in an event's error; empty where nothing is known to be."""
    if event.kind == LOAD_STEP:
        return OFF_REST if came_off_rest(event) else ""
    if fit is not None and drowns(event, fit):
        return DROWNED
    return LOAD_BESIDE if fit is not None and fit.other is not None else ""


def _predicted(
    loop: Loop,
    event: ClosedEvent,
    model: Model | None,
    ci: float | None,
    ms: float | None,
    *,
    drowned: bool,
) -> Indices:
    """Return the indices predicted: of an event that has shown its own index, or would have but for OP's limits.

    Or but for a load that wanders, in whose error its own is drowned.
    """
    if model is None or (ci is None and not at_limit(event) and not drowned):
        return NO_INDICES
    return indices_to_come(loop, model, _pair(event, ci), ms, event.period)


def _pair(event: ClosedEvent, ci: float | None) -> Indices:
    """Return an event's index as CI_sp and CI_ld."""
    return (None, ci) if event.kind == LOAD_STEP else (ci, None)


def _widened(fit: Fit, reconstructed: float) -> Fit:
    """Return a fit with the intervals that it has on values of which this share was left out or made up."""
    if reconstructed <= RECONSTRUCTED_SHARE:
        return fit
    return replace(fit, floor=RECONSTRUCTED_FLOOR_RATIO * fit.floor)


def _record(
    loop: Loop,
    event: ClosedEvent,
    fits: tuple[Fit | None, Fit | None],
    figures: Figures,
    said: tuple[str, str],
) -> Assessment:
    """Put a record together: ``fits`` are the model found and the one that is trusted."""
    (fit, trusted), (verdict, reason) = fits, said
    gain_integrals, t0_integrals = by_integrals(event, fit)
    onset, amplitude = event.onset, event.amplitude
    load = event.kind == LOAD_STEP
    if load:
        amplitude = (fit.size if fit is not None else None) or 0.0
        onset += round(fit.onset * 1e9) if fit is not None and fit.onset is not None else 0
    return Assessment(
        loop=loop.name,
        id=event_id(loop.name, event.onset),
        event=event.number,
        kind=LOAD if load else SETPOINT,
        start=onset,
        end=event.end,
        state=event.state,
        amplitude=amplitude,
        iae=event.iae,
        ci=figures.ci,
        process=UNDECIDED if trusted is None else trusted.process,
        method=None if fit is None else fit.method,
        fit=None if fit is None else fit.quality,
        coverage=coverage(event),
        verdict=verdict,
        reason=reason,
        ms=figures.ms,
        gain_integrals=gain_integrals,
        t0_integrals=t0_integrals,
        **({} if fit is None else model_values(fit)),
    )


def _said(
    loop: Loop,
    event: ClosedEvent,
    model: Model | None,
    figures: Figures,
    against: list[str],
) -> tuple[str, str]:
    """Verdict and reason; ``against`` is what speaks against the evidence."""
    ci, limited = figures.ci, at_limit(event)
    if against or model is None:
        verdict, reason = INCONCLUSIVE, "; ".join(against)
    else:
        over = 0.0 if event.kind == LOAD_STEP else overshoot(event)
        seen = _pair(event, ci)
        verdict, reason = judge(loop, model, seen, figures.ms, over, figures.predicted, figures.damped)
        reason = "; ".join(filter(None, [reason, how_it_ended(event)]))
        if limited and verdict == INCONCLUSIVE and figures.predicted == NO_INDICES:
            reason = f"{limited}, and none is predicted: its settings are not known"
    if limited and limited not in reason:
        reason = "; ".join(filter(None, [reason, limited]))
    if event.uncertain_share > MANY_UNCERTAIN_SHARE:
        said = f"{event.uncertain_share:.0%} of its samples are of uncertain quality"
        reason = "; ".join(filter(None, [reason, said]))
    return verdict, reason


def as_worked_with(loop: Loop, event: ClosedEvent, contradiction: str) -> tuple[ClosedEvent, str]:
    """Return a set-point step as the ramp that the controller's block makes of it; else as it is. And a ramp in words.

    Not where the data contradict the settings by which it is seen.
    """
    settings = settings_of(loop)
    if event.kind == SETPOINT_RAMP:
        return event, ramp_in_words(event)
    if event.kind != SETPOINT_STEP or settings is None or event.thinned or contradiction:
        return event, ""
    working = working_setpoint(event.window, settings, event.amplitude)
    if working is None:
        return event, ""
    window = replace(event.window, sp=working.sp)
    after = slice(window.before, None)
    error = np.abs(working.sp - window.pv)[after]
    noise = MEAN_ABS_SD * event.noise * event.duration
    iae = float(np.trapezoid(error, window.time[after]))
    said = f"the block ramps its set point by {working.rate:.3g} [PV/s], or filters it: OP answers no step"
    return replace(event, kind=SETPOINT_RAMP, window=window, iae=iae, iae_noise=min(noise, iae)), said


def ramp_in_words(event: ClosedEvent) -> str:
    """Say how a set point moved that did not step."""
    if event.cause == CAUSES[BY_MOVING]:
        return f"the set point moves all the time (by {abs(event.amplitude):.3g} [PV] in {duration(event.duration)})"
    w = event.window
    moved = w.time[1:][np.diff(w.sp) != 0.0]
    return f"the set point moved by {event.amplitude:+.3g} [PV] over {duration(moved[-1] if len(moved) else 0.0)}"


def model_values(fit: Fit) -> dict[str, float]:
    """Return the model's columns ``gain, t0, dead_time, lag``, without their intervals.

    A second lag counts half as lag, half as dead time (half rule, Skogestad 2003).
    """
    half = fit.lag2 / 2
    return {"gain": fit.gain, "t0": fit.t0, "dead_time": fit.dead_time + half, "lag": fit.lag + half}


def model_fields(fit: Fit) -> dict[str, float]:
    """Return the model's columns, each with its 95 % interval in ``_lo`` and ``_hi``."""
    values = model_values(fit)
    fields = dict(values)
    for name, value in values.items():
        more = value - float(getattr(fit, name))
        low, high = fit.told(name)
        fields |= {f"{name}_lo": low + more, f"{name}_hi": high + more}
    return fields
