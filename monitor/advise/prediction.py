"""What settings make of unit steps on a model, and how much of that counts for a loop's objective."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from monitor.assess.reference import model_of, reduced, reference_iae
from monitor.contract.loops import Loop
from monitor.contract.records import LOAD, SETPOINT
from monitor.identify.fit import Fit
from tuners.models import IntegratingModel, Model
from tuners.responses import step_figures
from tuners.settings import Settings

from .region import worst_peaks
from .stages import stacked

WORTH_SHARE = 0.85
"""A suggestion for speed must bring the predicted error below this share of today's."""
LEAST_REFERENCE_SHARE = 0.5
"""Least share of an uncertain reference's error that is still asked for."""
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
class Reference:
    """What is asked of a response to one kind of step."""

    iae: float
    """IAE of the reference, unit step."""
    enough: float
    """Share of it below which less is worth nothing."""


@dataclass(frozen=True, slots=True)
class References:
    """Those of the kinds of step that count for a loop's objective."""

    of: dict[str, Reference]
    """By kind of step; empty where none is known."""

    def error(self, predicted: Predicted) -> float:
        """Sum of the predicted errors over the reference's, as far as they matter."""
        return sum(max(predicted.iae[kind] / best.iae, best.enough) for kind, best in self.of.items())

    def index(self, predicted: Predicted) -> float | None:
        """Least predicted index."""
        indices = [
            best.iae / predicted.iae[kind] for kind, best in self.of.items() if predicted.iae[kind] > 0
        ]
        return min(indices, default=None)

    def worthwhile(self, loop: Loop, before: Predicted, after: Predicted) -> bool:
        """Whether the error that counts shrinks by 15 %, for one kind of step at least, and not at the other's cost."""
        shrinks = [after.iae[k] < WORTH_SHARE * before.iae[k] for k in WANTED.get(loop.objective, KINDS)]
        return any(shrinks) and not self.error(after) > self.error(before)


def references_of(loop: Loop, fit: Fit, structure: str, tc: float) -> References:
    """Return the references of a loop whose reference has the closed-loop time ``tc`` [s].

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
    found = {}
    for kind in WANTED.get(loop.objective, KINDS):
        sigma = time if kind == SETPOINT else load
        try:
            best = reference_iae(kind, 1.0, model, structure, tc, loop.b, loop.c)
        except ValueError:
            continue
        if math.isfinite(best):
            found[kind] = Reference(best, max(math.exp(-sigma), LEAST_REFERENCE_SHARE))
    return References(found)


def predict(
    model: Model, new: list[Settings], today: Settings | None
) -> tuple[list[Predicted], Predicted | None]:
    """Predict what each of the new settings, and today's where they are known, do on the model."""
    every = stacked([*new, *([] if today is None else [today])])
    found = step_figures(model, every, np.isfinite(worst_peaks(model, every)))
    rows = np.column_stack([found.overshoot, found.iae_setpoint, found.iae_load]).tolist()
    each = [
        Predicted(None if math.isnan(over) else over, dict(zip(KINDS, iae, strict=True)))
        for over, *iae in rows
    ]
    return each[: len(new)], None if today is None else each[-1]
