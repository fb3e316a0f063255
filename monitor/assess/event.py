"""What an event says of its loop: the index, and a verdict with its reason in plain words.

A verdict looks at speed (the closed-loop index CI) and at safety (peak sensitivity Ms of the current settings
on the identified model). Where the evidence cannot carry either, it says so instead.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from monitor.contract.loops import Loop
from monitor.contract.records import GOOD, INCONCLUSIVE, LOAD, SETPOINT, UNDECIDED, Assessment, event_id
from monitor.detect.event import LOAD_STEP, ClosedEvent
from monitor.identify.fit import Fit
from monitor.identify.misfit import ModelError, model_error
from monitor.identify.outliers import without_outliers
from tuners.models import Model

from .evidence import (
    MANY_UNCERTAIN_SHARE,
    WIDE_GAIN,
    by_integrals,
    coverage,
    evidence_against,
    how_it_ended,
    is_explained,
    is_load_step,
    op_moved,
)
from .index import index, overshoot
from .process import model_of_event, rivals
from .reference import model_of
from .tuning import current_sensitivity, judge

RECONSTRUCTED_SHARE = 0.5
"""Share of PV's values that a historian left out or made up, from which the intervals are wider."""
RECONSTRUCTED_FLOOR_RATIO = 4.0
"""What the variances of a model's mismatch grow by then. What was drawn between two values that were kept, or held,
follows no process: its error is neither noise nor the same at all times, and the residuals show a part of it only
(measured on simulated fleets: without it, one true gain in ten lies outside of the interval)."""
LOAD_BESIDE = "no index: a load came beside the set-point step, and the error is that one's, too"


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
    rivals: tuple[Fit, ...] = ()
    """Models of the other kind of process that the event does not exclude; looked for where settings may follow."""
    misfit: ModelError | None = None
    """The error of the model that the event shows, likewise."""

    @property
    def swing(self) -> float:
        """Standard deviation of PV in the event's window [PV]; 0 without a model."""
        if self.fit is None:
            return 0.0
        return self.fit.sigma / math.sqrt(max(1.0 - self.fit.quality, 1e-12))


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
        The loop's row; its settings are those in force during the event.
    extra_delay
        Dead time that the controller adds to the process [s].
    contradiction
        In what the data contradict the settings; then there is no Ms and no verdict.
    thorough
        Look at the other kind of process and the model's error even where the loop is good: a retune is under way.
    reconstructed
        Share of PV's values that a historian left out or made up, so far.
    """
    load = event.kind == LOAD_STEP
    event = without_outliers(event)
    shown = model_of_event(loop, event)
    fit = None if shown.fit is None else _widened(replace(shown.fit, extra_delay=extra_delay), reconstructed)
    shown, decided = shown._replace(fit=fit), shown.decided
    against = evidence_against(loop, event, fit, decided)
    # figures of a model that does not explain the event would only mislead
    trusted = fit if fit is not None and decided and is_explained(fit, event) else None
    ci = None if trusted is None else index(loop, event, trusted)
    model = None if trusted is None else model_of(trusted)
    ms = None if contradiction else current_sensitivity(loop, model, event.period)
    doubts = [*against, contradiction] if contradiction else against
    verdict, reason = _said(loop, event, model, (ci, ms), doubts)
    if ci is None and not doubts and not load and trusted is not None and trusted.other is not None:
        verdict, reason = (verdict, reason) if verdict != INCONCLUSIVE else (INCONCLUSIVE, LOAD_BESIDE)
    said = verdict, "; ".join(filter(None, [shown.contradiction, reason]))
    finding = Finding(
        _record(loop, event, (fit, trusted), (ci, ms), said),
        fit,
        usable=fit is not None and not against,
        wide=fit is not None and len(against) == 1 and against[0].startswith(WIDE_GAIN),
        is_event=not load or (fit is not None and is_load_step(fit, event) and op_moved(fit, event)),
        noise=event.noise,
        period=event.period,
    )
    if fit is None or not (finding.usable or finding.wide) or not (thorough or verdict != GOOD):
        return finding
    misfit = model_error(event.window, fit, event.noise)
    return replace(finding, rivals=rivals(event, shown), misfit=misfit)


def _widened(fit: Fit, reconstructed: float) -> Fit:
    """Return a fit with the intervals that it has on values of which this share was left out or made up."""
    if reconstructed <= RECONSTRUCTED_SHARE:
        return fit
    return replace(fit, floor=RECONSTRUCTED_FLOOR_RATIO * fit.floor)


def _record(
    loop: Loop,
    event: ClosedEvent,
    fits: tuple[Fit | None, Fit | None],
    figures: tuple[float | None, float | None],
    said: tuple[str, str],
) -> Assessment:
    """Put a record together: ``fits`` are the model found and the one that is trusted, ``figures`` CI and Ms."""
    (fit, trusted), (ci, ms), (verdict, reason) = fits, figures, said
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
        ci=ci,
        process=UNDECIDED if trusted is None else trusted.process,
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


def _said(
    loop: Loop,
    event: ClosedEvent,
    model: Model | None,
    figures: tuple[float | None, float | None],
    against: list[str],
) -> tuple[str, str]:
    """Verdict and reason; ``figures`` are CI and Ms, ``against`` is what speaks against the evidence."""
    ci, ms = figures
    if against or model is None:
        verdict, reason = INCONCLUSIVE, "; ".join(against)
    else:
        load = event.kind == LOAD_STEP
        over = 0.0 if load else overshoot(event)
        verdict, reason = judge(loop, model, (None, ci) if load else (ci, None), ms, over)
        reason = "; ".join(filter(None, [reason, how_it_ended(event)]))
    if event.uncertain_share > MANY_UNCERTAIN_SHARE:
        said = f"{event.uncertain_share:.0%} of its samples are of uncertain quality"
        reason = "; ".join(filter(None, [reason, said]))
    return verdict, reason


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
