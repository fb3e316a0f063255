"""A model and a verdict to new settings, or to the reason why there are none.

The reference rule of the loop's own structure (or a rule named by the user), slowed down until it is safe for every
model that the evidence allows, gentle enough on the valve, and within reach of the settings of today.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from monitor.assess.reference import (
    RULE,
    closed_loop_time,
    model_of,
    reduced,
    reference_structure,
    settings_of,
    structure_and_time,
)
from monitor.assess.tuning import MS_MARGIN_RATIO
from monitor.contract.loops import Loop
from monitor.identify.fit import Fit
from tuners.levels import averaging
from tuners.models import IntegratingModel
from tuners.settings import NotRepresentableError, Settings

from .candidates import (
    SLOWEST_RATIO,
    TIME_COUNT,
    Limits,
    Search,
    named_candidates,
    op_noise,
    reference_candidates,
    rule_mismatch,
    search,
)
from .evidence import Evidence
from .guards import Guards
from .path import Way, way
from .prediction import Predicted, predict, references_of
from .region import uncertain_models
from .stages import rounded

WITHOUT_LEAD = {"pid": "pi", "pd": "p"}
"""What a structure is before its derivative may be added."""
STEP_ASIDE_SHARE = 0.02
"""Gain, as a share of the reference's error, for which a suggestion goes one step away from the rule itself."""


@dataclass(frozen=True, slots=True)
class Advice:
    """Settings to type in now, what they will do, and where they lead."""

    rule: str
    settings: Settings
    """To be typed in now, in the loop's own form: safe on the evidence."""
    aim: Settings
    """What the search found: where the settings lead."""
    closed_loop_time: float
    """tc for which the aim holds; NaN for a rule without [s]."""
    ms: float
    ms_worst: float
    """For the worst model inside the intervals."""
    ci: float | None
    """Predicted; by the loop's own reference, the least of those that count for its objective."""
    op_noise: float
    """Standard deviation that PV's noise will put on OP [OP]."""
    before: Predicted | None
    """By today's settings."""
    after: Predicted
    """By the new ones."""
    stages: list[Settings]
    """The way as far as it is foreseen: the settings to be typed in now first, the aim last."""
    limited_by: str = ""
    """What keeps the rest of the way back, in words; empty where there is none."""
    soft: bool = False
    """A small step that is taken in spite of the model's error: once for a model."""


@dataclass(frozen=True, slots=True)
class Withheld:
    """No suggestion, and why."""

    reason: str
    fine_as_it_is: bool = False
    """The reason is that nothing is to be gained."""


def advise(
    loop: Loop, fit: Fit, noise: float, period: float, ms: float | None, evidence: Evidence
) -> Advice | Withheld:
    """Find the best settings of a rule that are safe, gentle and in reach.

    The rule is the one that the loop table names, where it is for the loop's structure and kind of process, else the
    reference rule. One with a closed-loop time is slowed down like the reference; one without is taken as it is, or
    not at all.

    Parameters
    ----------
    loop
        With the settings of today, where known.
    fit
        Process with its uncertainty; the suggestion holds for all of it.
    noise
        Standard deviation of PV's noise [PV].
    period
        Sample period, for the least closed-loop time and for the noise's way through the controller [s].
    ms
        Peak sensitivity of today's settings on the model, None where not known.
    evidence
        What the events leave open beside the model's intervals: how far one may go now.
    """
    if loop.kp is not None and loop.kp * fit.gain < 0:
        return Withheld(
            "today's gain has the other sign than the process found: check the sign of kp in the table"
        )
    limits = Limits(loop, uncertain_models(fit, period), noise, period)
    guards = Guards.of(loop, limits.region, evidence, period)
    if loop.objective == "averaging":
        return _averaging(limits, guards, fit)
    model = model_of(fit)
    structure, tc = structure_and_time(loop, model, period)
    name = loop.rule if loop.rule and not rule_mismatch(loop, fit.process) else RULE[structure]
    ruled = WITHOUT_LEAD.get(structure, structure) if guards.lead_withheld else structure
    name = name if ruled == structure else RULE[ruled]
    times = closed_loop_time(loop, reduced(model, ruled), period) * np.geomspace(
        1.0, SLOWEST_RATIO, TIME_COUNT
    )
    try:
        if name == RULE[ruled]:
            candidates = reference_candidates(loop, model, ruled, times)
        else:
            times, candidates = named_candidates(limits, name, model, times)
        found = search(limits, times, candidates)
        if found.loud and name == RULE[ruled]:
            found = search(limits, times, reference_candidates(loop, model, ruled, times, loud=True))
        return _best(found, guards, fit, structure, (tc, name, ms))
    except (ValueError, NotRepresentableError) as error:
        return Withheld(f"no settings of the rule {name} for this model: {error}")


def renewed(
    advice: Advice, loop: Loop, fit: Fit, noise: float, period: float, evidence: Evidence
) -> Advice | None:
    """Return a suggestion that stands with the figures of a newer model; None where it is not safe on that any more.

    The aim is kept, the part to be typed in now is looked for again, from the settings of today. None also where
    there is no such part: the aim is reached, or the evidence does not allow a step. Parameters are those of `advise`.
    """
    limits = Limits(loop, uncertain_models(fit, period), noise, period)
    peaks = limits.worst(advice.aim)
    if not limits.kept_by(advice.aim, peaks):
        return None
    found = way(limits, Guards.of(loop, limits.region, evidence, period), advice.aim, peaks)
    if isinstance(found, str):
        return None
    model = model_of(fit)
    structure, tc = structure_and_time(loop, model, period)
    (after,), before = predict(model, [found.now], settings_of(loop))
    ci = None if advice.ci is None else references_of(loop, fit, structure, tc).index(after)
    return _advice(limits, found, (advice.rule, advice.closed_loop_time), ci, before, after)


def _best(
    found: Search, guards: Guards, fit: Fit, structure: str, of: tuple[float, str, float | None]
) -> Advice | Withheld:
    """Take the candidate that serves the loop's objective best and is, looked at exactly, safe: the aim; then its way.

    ``of`` are the reference's closed-loop time, the rule's name and today's Ms.
    """
    limits, loop = found.limits, found.limits.loop
    tc, rule, ms = of
    today, model = settings_of(loop), model_of(fit)
    references = references_of(loop, fit, structure, tc)
    while found.at:
        candidates = found.typed()
        each, before = predict(model, list(candidates.values()), today)
        errors = [references.error(after) for after in each]
        k = min(range(len(candidates)), key=lambda n: errors[n] + STEP_ASIDE_SHARE * n)
        row, aim = list(candidates.items())[k]
        peaks = limits.worst(aim)
        if not limits.kept_by(aim, peaks):
            found.slower(row)
            continue
        quiet = ms is not None and ms <= MS_MARGIN_RATIO * loop.ms_max
        if before is not None and quiet and not references.worthwhile(loop, before, each[k]):
            return Withheld(
                "as tight as the evidence allows: no safe settings are 15 % better", fine_as_it_is=True
            )
        walked = way(limits, guards, aim, peaks)
        if isinstance(walked, str):
            return Withheld(walked)
        after = each[k] if walked.now == aim else predict(model, [walked.now], None)[0][0]
        aimed = rule, float(found.times[found.at[row]])
        return _advice(limits, walked, aimed, references.index(after), before, after)
    return Withheld(found.failing)


def _advice(
    limits: Limits, walked: Way, aimed: tuple[str, float], ci: float | None,
    before: Predicted | None, after: Predicted,
) -> Advice:  # fmt: skip
    """Put a suggestion together; ``aimed`` are the aim's rule and its closed-loop time."""
    (rule, tc), now, aim = aimed, walked.now, walked.stages[-1]
    noise = float(op_noise(now, limits.noise, limits.period))
    return Advice(
        rule,
        now,
        aim,
        tc,
        *walked.peaks,
        ci,
        noise,
        before,
        after,
        walked.stages,
        walked.limited_by,
        walked.soft,
    )


def _averaging(limits: Limits, guards: Guards, fit: Fit) -> Advice | Withheld:
    """Suggest for a surge vessel the gain that its load and room ask for, and as much integral as damping allows.

    ``|Kc| = max_load/max_deviation`` (today's where these are not known), ``Ti = 4/(Kc K)``: damping 1 for a
    small dead time. No integral where the loop has none.
    """
    loop, model = limits.loop, model_of(fit)
    today = settings_of(loop)
    if not isinstance(model, IntegratingModel):
        return Withheld("the averaging rule is for integrating processes")
    if loop.max_load is not None and loop.max_deviation is not None:
        size = rounded(loop.max_load / loop.max_deviation)
    elif today is not None:
        size = abs(float(today.kp))
    else:
        return Withheld("the averaging rule needs max_load and max_deviation, or today's settings")
    rule = averaging(model, size, 1.0)  # its integral time is for the gain as one types it
    kp, integral = float(rule.kp), reference_structure(loop) in {"pi", "pid"}
    ti = rounded(float(rule.ti)) if integral else math.inf
    new = Settings(kp, ti, 0.0, 0.0, loop.canonical_form, loop.b, loop.c)
    peaks = limits.worst(new)
    broken = [why for why, where in limits.broken(new) if np.any(where)]
    if peaks[1] > loop.ms_max or broken:
        return Withheld("; ".join([limits.too_sensitive()] * (peaks[1] > loop.ms_max) + broken))
    walked = way(limits, guards, new, peaks)
    if isinstance(walked, str):
        return Withheld(walked)
    (after,), before = predict(model, [walked.now], today)
    return _advice(limits, walked, ("averaging", 1.0 / (kp * fit.gain)), None, before, after)
