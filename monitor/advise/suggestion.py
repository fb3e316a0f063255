"""A model and a verdict to new settings, or to the reason why there are none.

The reference rule of the loop's own structure (or a rule named by the user), slowed down until it is safe for every
model that the evidence allows, gentle enough on the valve, and within reach of the settings of today.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from monitor.assess.reference import (
    LOAD,
    RULE,
    SETPOINT,
    closed_loop_time,
    model_of,
    reduced,
    reference_iae,
    reference_structure,
    settings_of,
)
from monitor.assess.tuning import MARGIN
from monitor.contract.loops import Loop
from monitor.identify.fit import Fit
from tuners.models import IntegratingModel, Model
from tuners.responses import step_figures
from tuners.settings import NotRepresentableError, Settings

from .candidates import (
    SLOWEST,
    TIMES,
    Limits,
    Search,
    named_candidates,
    op_noise,
    reference_candidates,
    rule_mismatch,
    search,
)
from .region import uncertain_models, worst_peaks
from .stages import rounded, stacked, stages

GAIN_WORTH = 0.85
"""A suggestion for speed must bring the predicted error below this share of today's."""
LEAST_SHARE = 0.5
"""Least share of an uncertain reference's error that is still asked for."""
NEAR = 0.02
"""Gain, as a share of the reference's error, for which a suggestion goes one step away from the rule itself."""
KINDS = (SETPOINT, LOAD)
WANTED = {SETPOINT: (SETPOINT,), LOAD: (LOAD,)}
"""Kinds of step that count for an objective; both where it is not named here."""


@dataclass(frozen=True, slots=True)
class Predicted:
    """What settings make of unit steps on the model."""

    overshoot: float | None
    """Share of a set-point step; None for an unstable loop."""
    iae: dict[str, float]
    """By kind of step [s], [PV s/OP]; inf for an unstable loop, or an error that stays."""


@dataclass(frozen=True, slots=True)
class Advice:
    """Safe new settings and what they will do."""

    rule: str
    settings: Settings
    """In the loop's own form."""
    closed_loop_time: float
    """tc for which they hold; NaN for a rule without [s]."""
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
    """Settings to go through; the last one is the suggestion."""


@dataclass(frozen=True, slots=True)
class Withheld:
    """No suggestion, and why."""

    reason: str
    fine_as_it_is: bool = False
    """The reason is that nothing is to be gained."""


def advise(loop: Loop, fit: Fit, noise: float, period: float, ms: float | None) -> Advice | Withheld:
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
    """
    if loop.kp is not None and loop.kp * fit.gain < 0:
        return Withheld(
            "today's gain has the other sign than the process found: check the sign of kp in the table"
        )
    limits = Limits(loop, uncertain_models(fit, period), noise, period)
    if loop.objective == "averaging":
        return _averaging(limits, fit)
    model = model_of(fit)
    structure = reference_structure(loop)
    tc = closed_loop_time(loop, reduced(model, structure), period)
    times = tc * np.geomspace(1.0, SLOWEST, TIMES)
    name = loop.rule if loop.rule and not rule_mismatch(loop, fit.process) else RULE[structure]
    try:
        if name == RULE[structure]:
            candidates = reference_candidates(loop, model, structure, times)
        else:
            times, candidates = named_candidates(name, model, times)
        found = search(limits, times, candidates)
        if found.loud and name == RULE[structure]:
            found = search(limits, times, reference_candidates(loop, model, structure, times, loud=True))
        return _best(found, fit, structure, tc, name, ms)
    except (ValueError, NotRepresentableError) as error:
        return Withheld(f"no settings of the rule {name} for this model: {error}")


def renewed(advice: Advice, loop: Loop, fit: Fit, noise: float, period: float) -> Advice | None:
    """Return a suggestion that stands with the figures of a newer model; None where it is not safe on that any more.

    Parameters are those of `advise`.
    """
    limits = Limits(loop, uncertain_models(fit, period), noise, period)
    new, model = advice.settings, model_of(fit)
    peaks = limits.worst(new)
    if peaks[1] > loop.ms_max or any(np.any(where) for _, where in limits.broken(new)):
        return None
    (after,), before = _predicted(model, [new], settings_of(loop))
    structure = reference_structure(loop)
    tc = closed_loop_time(loop, reduced(model, structure), period)
    ci = None if advice.ci is None else _index(_references(loop, fit, structure, tc), after)
    return _advice(limits, advice.rule, new, advice.closed_loop_time, peaks, ci, before, after)


def _best(
    found: Search, fit: Fit, structure: str, tc: float, rule: str, ms: float | None
) -> Advice | Withheld:
    """Take the candidate that serves the loop's objective best and is, looked at exactly, safe."""
    limits, loop = found.limits, found.limits.loop
    today, model = settings_of(loop), model_of(fit)
    references = _references(loop, fit, structure, tc)
    while found.at:
        candidates = found.typed()
        each, before = _predicted(model, list(candidates.values()), today)
        errors = [_error(references, after) for after in each]
        k = min(range(len(candidates)), key=lambda n: errors[n] + NEAR * n)
        row, new = list(candidates.items())[k]
        peaks = limits.worst(new)
        if peaks[1] > loop.ms_max or any(np.any(where) for _, where in limits.broken(new)):
            found.slower(row)
            continue
        quiet = ms is not None and ms <= MARGIN * loop.ms_max
        if before is not None and quiet and not _worthwhile(loop, references, before, each[k]):
            return Withheld(
                "as tight as the evidence allows: no safe settings are 15 % better", fine_as_it_is=True
            )
        tc_found = float(found.times[found.at[row]])
        return _advice(limits, rule, new, tc_found, peaks, _index(references, each[k]), before, each[k])
    return Withheld(found.failing)


def _advice(
    limits: Limits, rule: str, new: Settings, tc: float, peaks: tuple[float, float], ci: float | None,
    before: Predicted | None, after: Predicted,
) -> Advice:  # fmt: skip
    """Put a suggestion together; ``peaks`` are Ms on the model found and on the worst one."""
    today = settings_of(limits.loop)
    noise = float(op_noise(new, limits.noise, limits.period))
    way = [new] if today is None else stages(limits.region, today, new, limits.loop.ms_max)
    return Advice(rule, new, tc, *peaks, ci, noise, before, after, way)


def _worthwhile(loop: Loop, references: dict[str, _Reference], before: Predicted, after: Predicted) -> bool:
    """Whether the error that counts shrinks by 15 %, for one kind of step at least, and not at the other's cost."""
    shrinks = [after.iae[k] < GAIN_WORTH * before.iae[k] for k in WANTED.get(loop.objective, KINDS)]
    return any(shrinks) and not _error(references, after) > _error(references, before)


@dataclass(frozen=True, slots=True)
class _Reference:
    """What is asked of a response to one kind of step."""

    iae: float
    """IAE of the reference, unit step."""
    enough: float
    """Share of it below which less is worth nothing."""


def _references(loop: Loop, fit: Fit, structure: str, tc: float) -> dict[str, _Reference]:
    """Return the references of the kinds of step that count, empty where none is known.

    To be better than the reference is worth nothing, but for one sigma of the reference: its errors go with
    tc + theta, or for a load with gain (tc + theta)^2, of the model found. (Without that margin a dead time that was
    found too long makes a suggestion too slow by its square.)
    """
    model = model_of(fit)
    theta = float(reduced(model, structure).dead_time)
    half = 0.5 if structure in {"p", "pi"} and isinstance(model, IntegratingModel) else 0.0
    weights = np.array([0.0, half, 1.0])
    moved = 2.0 if loop.closed_loop_time is None and tc == theta else 1.0  # tc goes with the dead time
    time = moved * math.sqrt(max(float(weights @ fit.cov @ weights), 0.0)) / (tc + theta)
    load = math.hypot(2.0 * time, math.sqrt(fit.cov[0, 0]))
    references = {}
    for kind in WANTED.get(loop.objective, KINDS):
        sigma = time if kind == SETPOINT else load
        try:
            best = reference_iae(kind, 1.0, model, structure, tc, loop.b, loop.c)
        except ValueError:
            continue
        if math.isfinite(best):
            references[kind] = _Reference(best, max(math.exp(-sigma), LEAST_SHARE))
    return references


def _error(references: dict[str, _Reference], predicted: Predicted) -> float:
    """Sum of the predicted errors over the reference's, as far as they matter."""
    return sum(max(predicted.iae[kind] / best.iae, best.enough) for kind, best in references.items())


def _index(references: dict[str, _Reference], predicted: Predicted) -> float | None:
    """Least predicted index."""
    indices = [best.iae / predicted.iae[kind] for kind, best in references.items() if predicted.iae[kind] > 0]
    return min(indices, default=None)


def _predicted(
    model: Model, new: list[Settings], today: Settings | None
) -> tuple[list[Predicted], Predicted | None]:
    """Predict what each of the new settings, and today's where they are known, do on the model."""
    every = stacked([*new, *([] if today is None else [today])])
    found = step_figures(model, every, np.isfinite(worst_peaks(model, every)))
    rows = np.column_stack([found.overshoot, found.iae_setpoint, found.iae_load]).tolist()
    predicted = [
        Predicted(None if math.isnan(over) else over, dict(zip(KINDS, iae, strict=True)))
        for over, *iae in rows
    ]
    return predicted[: len(new)], None if today is None else predicted[-1]


def _averaging(limits: Limits, fit: Fit) -> Advice | Withheld:
    """Suggest for a surge vessel the gain that its load and room ask for, and as much integral as damping allows.

    ``|Kc| = max_load/max_deviation`` (today's where these are not known), ``Ti = 4/(Kc K)``: damping 1 for a
    small dead time. No integral where the loop has none.
    """
    loop, model = limits.loop, model_of(fit)
    today = settings_of(loop)
    if not isinstance(model, IntegratingModel):
        return Withheld("the averaging rule is for integrating processes")
    if loop.max_load is not None and loop.max_deviation is not None:
        kp = rounded(math.copysign(loop.max_load / loop.max_deviation, fit.gain))
    elif today is not None:
        kp = float(today.kp)
    else:
        return Withheld("the averaging rule needs max_load and max_deviation, or today's settings")
    integral = reference_structure(loop) in {"pi", "pid"}
    ti = rounded(4.0 / (kp * fit.gain)) if integral else math.inf
    new = Settings(kp, ti, 0.0, 0.0, loop.canonical_form, loop.b, loop.c)
    peaks = limits.worst(new)
    broken = [why for why, where in limits.broken(new) if np.any(where)]
    if peaks[1] > loop.ms_max or broken:
        return Withheld("; ".join([limits.too_sensitive()] * (peaks[1] > loop.ms_max) + broken))
    (after,), before = _predicted(model, [new], today)
    return _advice(limits, "averaging", new, 1.0 / (kp * fit.gain), peaks, None, before, after)
