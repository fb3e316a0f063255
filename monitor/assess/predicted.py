"""The indices that no event has shown: of unit steps, simulated under the settings of today on the model found."""

from __future__ import annotations

import math

import numpy as np

from monitor.contract.loops import Loop
from monitor.contract.records import LOAD, SETPOINT
from tuners.models import Model
from tuners.responses import step_figures

from .reference import reference_iae, settings_of, structure_and_time, with_hold_delay

Indices = tuple[float | None, float | None]
"""CI_sp and CI_ld; None where there is none."""
NO_INDICES: Indices = (None, None)


def predicted_indices(loop: Loop, model: Model, ms: float | None, period: float) -> Indices:
    """Return CI_sp and CI_ld of the settings of today on a model, by the definition of the measured ones (derived).

    The reference's IAE after a unit step (`reference_iae`) over that of the linear loop: no limit of OP, no noise, and
    half a sample period more of dead time, as the sampled controller meets the process. Without integral action a load
    leaves an error for good, and no reference: None.

    Parameters
    ----------
    loop
        With the settings of today.
    model
        Process, without the hold's delay.
    ms
        Peak sensitivity of these settings on it; None where they are not known, inf where they are unstable [-].
    period
        Of the samples [s].
    """
    settings = settings_of(loop)
    if settings is None or ms is None or math.isinf(ms):
        return NO_INDICES
    structure, tc = structure_and_time(loop, model, period)
    made = step_figures(with_hold_delay(model, period), settings, np.array([True]))
    found: list[float | None] = []
    for kind, iae in ((SETPOINT, float(made.iae_setpoint[0])), (LOAD, float(made.iae_load[0]))):
        try:
            best = reference_iae(kind, 1.0, model, structure, tc, loop.b, loop.c)
        except ValueError:
            best = math.nan
        known = math.isfinite(best) and math.isfinite(iae) and iae > 0.0
        found.append(best / iae if known else None)
    return found[0], found[1]
