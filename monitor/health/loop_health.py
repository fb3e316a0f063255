"""A loop's health so far, read from its running sums. A figure that the data cannot carry is None."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

from . import coverage, harris, measurement, offset, saturation, tag_mapping, travel
from .diagnosis import NO_SIGNS, Signs
from .oscillation import any_block, strongest, too_fast
from .regulation import Regulation, regulation_of
from .stiction import stiction_of

SATURATED_SHARE = 0.1
"""Share of the time at its limits from which on a limit cycle is the limits', not the valve's."""
OSCILLATING_REGULARITY = 0.5
"""Regularity from which on a loop oscillates."""
SHAPE_STEPS = 2.0
"""Steps of PV that an oscillation's amplitude must have for its shape to be seen."""
HARRIS_COMPRESSION = 0.5
"""Compression above which a Harris index means nothing (half the values are made up)."""
HARRIS_QUANTUM_SD = 1.0
"""Step of PV over the error's standard deviation above which a Harris index means nothing."""
HARRIS_SAMPLES = 0.5
"""Samples in a dead time without which the sampling does not resolve it."""


@dataclass(frozen=True, slots=True)
class Health:
    """A loop's health so far; most fields are columns of the loop's row, None where nothing can be said.

    Times, offset, mean error, path of OP and the oscillation's period are the same at any sampling that follows the
    loop; reversals, noise, regularity and the Harris index hold for the loop's own sampling.
    """

    coverage: float | None = None
    """Good time / wall time."""
    manual: float | None = None
    """Share of time."""
    saturation: float | None = None
    """Share of time at OP's limits; where none are known, at rest exactly at OP's own extremes."""
    offset: float | None = None
    """Mean error in automatic [PV]."""
    noise: float | None = None
    """Standard deviation of PV's white noise [PV]; None where it is not white at this sampling."""
    quantum: float | None = None
    """Step of which PV's changes are multiples [PV]; None for a PV that has none, or none near its noise."""
    travel_per_hour: float | None = None
    """Path of OP in swings of more than three standard deviations of its own noise [OP/h]."""
    reversals_per_hour: float | None = None
    """Turns of that path [1/h]."""
    oscillation_period: float | None = None
    """[s]; None for a loop that does not oscillate, or with cycles of all lengths."""
    oscillation_regularity: float | None = None
    """0 to 1, how surely the error swings on and on; from 0.5 on the loop oscillates."""
    stiction: float | None = None
    """0 to 1, how surely the oscillation is a sticking valve's; None without an oscillation."""
    harris: float | None = None
    """Minimum variance over variance of the error: 1 is as good as it gets."""
    compression: float | None = None
    """Share of PV's values that an archive left out or made up, 0 to 1."""
    op_noise: float | None = None
    """Standard deviation of OP's white noise [OP]."""
    mean_abs_e: float | None = None
    """Mean size of the error in automatic [PV]."""
    settled_offset: bool = False
    """Whether the offset never goes away, and is more than noise."""
    oscillating: bool = False
    """Whether the loop oscillates."""
    stuck: bool = False
    """Whether PV was exactly the same for long while OP moved."""
    idle: bool = False
    """Whether PV, SP and OP rest nearly always."""
    held: float | None = None
    """Share of time in which nobody seems to control, by the tags' own mode in automatic: OP rests while the error
    moves, or SP tracks PV."""
    sp_moving: float | None = None
    """Share of samples at which SP moved."""
    mapping: bool = False
    """Whether the tags look wrongly wired."""
    units: str | None = None
    """What shows that SP is in another unit than PV, all the time; None where nothing does."""
    config_change: bool = False
    """Whether SP and PV jumped by the same factor, as if their unit had changed."""
    dead_band: float | None = None
    """By which PV must change for a row to come, about [PV]; None for rows that come at a rate."""
    undersampled: bool = False
    """Whether the response is over before it is seen."""
    pv_moving: float | None = None
    """Share of samples at which PV moved."""
    signs: Signs = NO_SIGNS
    """What is wrong with it, as its blocks show."""
    regulation: Regulation | None = None
    """The error in routine operation, where no dead time is known that would give a Harris index."""


def figures(health: Any, period: float, dead_time: float | None = None) -> Health:
    """Read a loop's health.

    Parameters
    ----------
    health
        Its record (dtype `HEALTH`).
    period
        Of its samples [s], 0 where it is not known.
    dead_time
        If known [s]: for the Harris index.
    """
    watched, measured = health["coverage"], health["measurement"]
    good, auto = float(watched["good_time"]), float(watched["auto_time"])
    if watched["wall_time"] <= 0 or good <= 0:
        return Health()
    out: dict[str, Any] = {
        "coverage": coverage.coverage_of(watched),
        "manual": coverage.manual_of(watched),
        "noise": measurement.noise_of(measured),
        "quantum": measurement.quantum_of(measured),
        "compression": measurement.compression_of(measured),
        "pv_moving": measurement.moving_of(measured),
        "stuck": measurement.is_stuck(measured, good),
        "idle": measurement.is_idle(measured, good),
    }
    if auto > 0:
        out |= _of_control(health, auto, period, out)
        out |= _of_cycles(health["autocorrelation"], out)
        spacing = float(health["autocorrelation"]["spacing"])
        if dead_time is None:
            out["regulation"] = regulation_of(health["harris"], health["autocorrelation"], out["noise"])
        out["harris"] = _harris(health["harris"], spacing, dead_time, out)
    known: dict[str, Any] = {k: v for k, v in out.items() if not isinstance(v, float) or math.isfinite(v)}
    return Health(**known)


def by_exception(health: Health, dead_band: float | None) -> Health:
    """Return a loop's health with what rows on change alone make of it: PV has the dead band's resolution.

    What rests between such rows is held, not idle: figures that take it for the plant's are left out.
    """
    if dead_band is None:
        return health
    return replace(
        health,
        dead_band=dead_band,
        quantum=max(health.quantum or 0.0, dead_band),
        idle=False,
        stuck=False,
        harris=None,
        noise=None,
    )


def _of_control(health: Any, auto: float, period: float, known: dict[str, Any]) -> dict[str, Any]:
    """Return what concerns the time in automatic ``auto`` [s]; ``period``: of the samples [s]."""
    error, op, tags = health["offset"], health["saturation"], health["tag_mapping"]
    noise, quantum = known["noise"] or 0.0, known["quantum"] or 0.0
    path, turns = travel.travel_of(health["travel"], period, saturation.never_moved(op))
    return {
        "saturation": saturation.saturation_of(op, auto),
        "offset": offset.offset_of(error, auto),
        "op_noise": travel.noise_of(health["travel"]),
        "mean_abs_e": offset.mean_size_of(error, auto),
        "settled_offset": offset.is_permanent(error, max(noise, quantum)),
        "travel_per_hour": path,
        "reversals_per_hour": turns,
        "held": max(saturation.held_of(op, auto), tag_mapping.tracking_of(tags)),
        "sp_moving": tag_mapping.sp_moving_of(tags),
        "mapping": tag_mapping.mapping_of(tags),
        "config_change": tag_mapping.unit_changed(tags),
        "undersampled": tag_mapping.undersampled_of(tags, noise) or too_fast(health["autocorrelation"]),
    }


def _of_cycles(error: Any, known: dict[str, Any]) -> dict[str, Any]:
    """Return oscillation and stiction, of the ``error``'s autocorrelation."""
    found = strongest(error)
    if found is None:
        return {"oscillation_regularity": 0.0 if any_block(error) else None}
    quantum = known["quantum"] or 0.0
    oscillating = found.regularity >= OSCILLATING_REGULARITY and found.amplitude > quantum
    out: dict[str, Any] = {"oscillation_regularity": found.regularity, "oscillating": oscillating}
    if oscillating:
        out["oscillation_period"] = None if found.uneven else found.period
        if found.amplitude > SHAPE_STEPS * quantum and known["saturation"] < SATURATED_SHARE:
            out["stiction"] = stiction_of(error["levels"][found.level]["cycles"])
    return out


def _harris(own: Any, period: float, dead_time: float | None, known: dict[str, Any]) -> float | None:
    """Return the Harris index where its conditions hold: a dead time that the sampling resolves, data as measured."""
    if dead_time is None or period <= 0 or dead_time < HARRIS_SAMPLES * period:
        return None
    if (known["compression"] or 0.0) > HARRIS_COMPRESSION:
        return None
    spread = harris.spread_of(own)
    if spread is None or (known["quantum"] or 0.0) > HARRIS_QUANTUM_SD * spread:
        return None
    return harris.harris_of(own, round(dead_time / period))
