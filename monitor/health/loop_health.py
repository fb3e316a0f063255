"""A loop's health so far, read from its running sums. A figure that the data cannot carry is None."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from . import harris, measurement, saturation, tag_mapping, travel
from .oscillation import strongest, too_fast
from .stiction import stiction_of

SHARE = 0.05
"""Share of the time from which on a frozen PV counts."""
IDLE = 0.8
"""Share of the time at rest from which on a loop counts as idle."""
SATURATED = 0.1
"""Share of the time at its limits from which on a limit cycle is the limits', not the valve's."""
OSCILLATES = 0.5
"""Regularity from which on a loop oscillates."""
RESOLVED = 2.0
"""Steps of PV that an oscillation's amplitude must have for its shape to be seen."""
PERMANENT = 2.0
"""Mean error over the standard deviation of its means over 64 samples, from which on it never goes away."""
VISIBLE = 0.5
"""Least permanent offset, in standard deviations of noise or steps of PV."""
MEANS = 10.0
"""Blocks without which an offset is not called permanent."""
MOST_COMPRESSED = 0.5
"""Compression above which a Harris index means nothing (half the values are made up)."""
COARSE = 1.0
"""Step of PV over the error's standard deviation above which a Harris index means nothing."""


@dataclass(frozen=True, slots=True)
class Health:
    """A loop's health so far; most fields are columns of the loop's row, None where nothing can be said.

    Times, offset, mean error, way of OP and the oscillation's period are the same at any sampling that follows the
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
    """Way of OP in swings of more than three standard deviations of its own noise [OP/h]."""
    reversals_per_hour: float | None = None
    """Turns of that way [1/h]."""
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
    config_change: bool = False
    """Whether SP and PV jumped by the same factor, as if their unit had changed."""
    undersampled: bool = False
    """Whether the response is over before it is seen."""


def figures(h: Any, period: float, dead_time: float | None = None) -> Health:
    """Read a loop's health.

    Parameters
    ----------
    h
        Its running sums (dtype `HEALTH`).
    period
        Of its samples [s], 0 where it is not known.
    dead_time
        If known [s]: for the Harris index.
    """
    wall, good, auto = (float(h[n]) for n in ("wall_time", "good_time", "auto_time"))
    if wall <= 0 or good <= 0:
        return Health()
    out: dict[str, Any] = {
        "coverage": min(good / wall, 1.0),
        "manual": min(float(h["manual_time"]) / good, 1.0),
        "noise": measurement.noise_of(h),
        "quantum": measurement.quantum_of(h),
        "compression": measurement.compression_of(h),
        "stuck": bool(h["stuck_time"] > SHARE * good),
        "idle": bool(h["idle_time"] > IDLE * good),
    }
    if auto > 0:
        out |= _of_control(h, auto, period)
        out |= _of_cycles(h, out)
        out["harris"] = _harris(h, float(h["spacing"]), dead_time, out)
    known: dict[str, Any] = {k: v for k, v in out.items() if not isinstance(v, float) or math.isfinite(v)}
    return Health(**known)


def _of_control(h: Any, auto: float, period: float) -> dict[str, Any]:
    """Return what concerns the time in automatic ``auto`` [s]; ``period``: of the samples [s]."""
    way, turns = travel.travel_of(h, period)
    held = min(float(h["held_time"]) / auto, 1.0)
    tracking = tag_mapping.tracking_of(h)
    return {
        "saturation": saturation.saturation_of(h, auto),
        "offset": float(h["sum_e"]) / auto,
        "op_noise": float(h["op_noise"]) if h["op_known"] > 0 else None,
        "mean_abs_e": float(h["abs_e"]) / auto,
        "settled_offset": _permanent(h),
        "travel_per_hour": way,
        "reversals_per_hour": turns,
        "held": max(held, tracking if tracking > tag_mapping.EXACT else 0.0),
        "sp_moving": tag_mapping.sp_moving_of(h),
        "mapping": tag_mapping.mapping_of(h) or tracking > tag_mapping.EXACT,
        "config_change": bool(h["w_units"] >= 0.5),
        "undersampled": tag_mapping.undersampled_of(h, measurement.noise_of(h) or 0.0) or too_fast(h),
    }


def _permanent(h: Any) -> bool:
    """Whether the error's mean is far from zero for good: integral action would have brought it back."""
    n = float(h["mean_n"])
    if n < MEANS:
        return False
    mean = float(h["mean_1"]) / n
    spread = math.sqrt(max(float(h["mean_2"]) / n - mean * mean, 0.0))
    least = VISIBLE * max(measurement.noise_of(h) or 0.0, measurement.quantum_of(h) or 0.0)
    return abs(mean) > max(PERMANENT * spread, least) and mean != 0.0


def _of_cycles(h: Any, known: dict[str, Any]) -> dict[str, Any]:
    """Return oscillation and stiction."""
    found = strongest(h)
    if found is None:
        return {"oscillation_regularity": 0.0 if h["blocks"][0] > 0 else None}
    quantum = known["quantum"] or 0.0
    oscillating = found.regularity >= OSCILLATES and found.amplitude > quantum
    out: dict[str, Any] = {"oscillation_regularity": found.regularity, "oscillating": oscillating}
    if oscillating:
        out["oscillation_period"] = None if found.uneven else found.period
        if found.amplitude > RESOLVED * quantum and known.get("saturation", 0.0) < SATURATED:
            out["stiction"] = stiction_of(h, found.level)
    return out


def _harris(h: Any, period: float, dead_time: float | None, known: dict[str, Any]) -> float | None:
    """Return the Harris index where its conditions hold: a dead time that the sampling resolves, data as measured."""
    if dead_time is None or period <= 0 or dead_time < 0.5 * period or not h["har_n"] > 0:
        return None
    if (known["compression"] or 0.0) > MOST_COMPRESSED:
        return None
    spread = math.sqrt(max(float(h["har_cov"][0] / h["har_n"]), 0.0))
    if (known["quantum"] or 0.0) > COARSE * spread:
        return None
    return harris.harris_of(h, round(dead_time / period))
