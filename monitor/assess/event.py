"""What an event says of its loop: the index, and a verdict with its reason in plain words.

A verdict looks at speed (the closed-loop index CI) and at safety (peak sensitivity Ms of the current settings
on the identified model). Where the evidence cannot carry either, it says so instead.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from monitor.contract.loops import Loop
from monitor.contract.records import INCONCLUSIVE, LOAD, SETPOINT, UNDECIDED, Assessment, event_id
from monitor.detect.event import LOAD_STEP, ClosedEvent
from monitor.identify.direct import fit_kinds
from monitor.identify.fit import Fit, contradictory, decide
from monitor.identify.indirect import LEAST_OP_EXPLAINED, indirect_fit, op_explained
from monitor.identify.outliers import without_outliers
from tuners.models import INTEGRATING, SELF_REGULATING, Model

from .evidence import (
    MANY_UNCERTAIN_SHARE,
    NOISY_RANGE_SHARE,
    by_integrals,
    coverage,
    evidence_against,
    how_it_ended,
    is_explained,
    is_load_step,
    op_moved,
)
from .index import index, overshoot
from .reference import model_of, settings_of
from .tuning import current_sensitivity, judge


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


def assess_event(loop: Loop, event: ClosedEvent) -> Finding:
    """Judge one closed event.

    Parameters
    ----------
    loop
        The loop's row; its settings are those in force during the event.
    """
    load = event.kind == LOAD_STEP
    event = without_outliers(event)
    fit, decided = _identify(loop, event)
    against = evidence_against(loop, event, fit, decided)
    # figures of a model that does not explain the event would only mislead
    trusted = fit if fit is not None and decided and is_explained(fit, event) else None
    ci = None if trusted is None else index(loop, event, trusted)
    model = None if trusted is None else model_of(trusted)
    ms = current_sensitivity(loop, model, event.period)
    verdict, reason = _said(loop, event, model, (ci, ms), against)
    gain_integrals, t0_integrals = by_integrals(event, fit)
    onset, amplitude = event.onset, event.amplitude
    if load:
        amplitude = (fit.size if fit is not None else None) or 0.0
        onset += round(fit.onset * 1e9) if fit is not None and fit.onset is not None else 0
    record = Assessment(
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
    return Finding(
        record,
        fit,
        usable=fit is not None and not against,
        is_event=not load or (fit is not None and is_load_step(fit, event) and op_moved(fit, event)),
        noise=event.noise,
        period=event.period,
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


def _identify(loop: Loop, event: ClosedEvent) -> tuple[Fit | None, bool]:
    """Fit the kinds of process that the loop may be; return the best and whether the kind is beyond doubt.

    Directly first. A set-point step under much noise is also fitted by simulating the closed loop, where the known
    settings reproduce OP: noise that travels round the loop biases the direct fit, while a wrong order of the
    model costs the simulated loop more. After a load step the simulated loop has false minima and is left out.
    """
    kinds = [INTEGRATING, SELF_REGULATING] if loop.process == "auto" else [loop.process]
    window, period, load = event.window, event.period, event.kind == LOAD_STEP
    span = float(window.time[-1])
    direct = fit_kinds(window, kinds, load, period)
    best, decided = decide(direct, span)
    settings = settings_of(loop)
    noisy = best is not None and best.sigma >= NOISY_RANGE_SHARE * float(np.ptp(window.pv))
    if best is None or load or settings is None or not noisy:
        return best, decided
    if op_explained(window, settings, period) < LEAST_OP_EXPLAINED:
        return best, decided
    fits = [indirect_fit(window, period, settings, f) for f in ([best] if decided else direct)]
    better = [f for f in fits if f is not None and is_explained(f, event) and not contradictory([f], best)]
    if not better:
        return best, decided
    chosen, sure = decide(better, span)
    return chosen, decided or (sure and len(better) == len(direct))
