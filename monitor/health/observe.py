"""What a loop's samples say of its health, beside its events: one call a sample, one look at the figures.

`observe` takes in one good sample, compiled, in O(1) memory a loop (about 5 kB); what needs more than a few
additions is done in blocks of 64 samples. `figures` reads the sums. Sums are halved every two weeks, so a monitor
speaks of the recent ones. A figure that the data cannot carry is None.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from monitor.detect.state import EVENT, QUIET, SETPOINT_STEP, jit

from . import harris, measurement, oscillation, saturation, tag_mapping, travel
from .oscillation import BLOCK, HORIZON, restart, space, strongest, taint, take, too_fast
from .stiction import stiction_of

SHARE = 0.05
"""Share of the time from which on a frozen PV counts."""
IDLE = 0.8
"""Share of the time at rest from which on a loop counts as idle."""
CASCADE = 0.2
"""Share of samples at which SP moves, above which no single move of it is a disturbance."""
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
MOST_MISSED = 3
"""Missed samples that are filled with the last value."""

_f = np.float64
_TIMES = "wall_time good_time manual_time auto_time since samples".split()
_SUMS = "abs_e sum_e mean_n mean_1 mean_2".split()
HEALTH = np.dtype(
    [
        *[(name, _f) for name in (*_TIMES, *_SUMS)],
        *saturation.FIELDS,
        *travel.FIELDS,
        *measurement.FIELDS,
        *tag_mapping.FIELDS,
        *harris.FIELDS,
        *oscillation.FIELDS,
    ]
)
"""A loop's running sums: times [s], everything else in units of PV and OP."""


@jit
def observe(h, s, p, dt, gap, sp, pv, op, auto):
    """Account for one good sample and the time ``dt`` [s] since the last; ``s`` still holds the last sample."""
    h.wall_time += dt
    measurement.interval(h, dt)
    if gap:
        measurement.blink(h)
        _interrupt(h)
        return
    # a missed sample is bridged, but does not count as covered
    h.good_time += dt if s.period == 0 else min(dt, 1.5 * s.period)
    if not s.auto:
        h.manual_time += dt
    measurement.sense(h, s, dt, sp, pv, op)
    if not s.auto or not auto:
        _interrupt(h)
        return
    last, e = s.sp - s.pv, sp - pv
    h.auto_time += dt
    h.abs_e += abs(last) * dt
    h.sum_e += last * dt
    saturation.rest(h, s, p, dt, op, e != last)
    travel.move(h, s, dt, op)
    tag_mapping.trace(h, s, e, sp, pv, op)
    if sp != s.sp and h.w_sp < CASCADE * h.w_n + 1.0:
        taint(h)
    if s.period <= 0.0:
        return
    space(h, s.period)
    h.samples += 1.0
    h.clock += dt
    n = int(h.clock / h.spacing + 0.5)
    h.clock -= n * h.spacing
    for _ in range(min(n, MOST_MISSED + 1)):
        clean = h.tainted & 1 == 0
        take(h, e)
        if h.taken & (BLOCK - 1) == 0:
            _block(h, s, clean, BLOCK * h.spacing)


@jit
def _block(h, s, clean, seconds):
    """Do what is done once in 64 samples; ``clean``: the set point has not stepped."""
    travel.weigh_moves(h, h.samples)
    measurement.weigh_noise(h, h.samples, s.phase <= QUIET)
    h.samples = 0.0
    if clean and not (s.phase == EVENT and s.kind == SETPOINT_STEP):
        harris.correlate(h)
        mean = 0.0
        for i in range(BLOCK):
            mean += h.block[0, i]
        mean /= BLOCK
        h.mean_n += 1.0
        h.mean_1 += mean
        h.mean_2 += mean * mean
    h.since += seconds
    if h.since > HORIZON:
        _fade(h)


@jit
def _interrupt(h):
    """Begin anew what must not reach across a gap or a change of mode."""
    restart(h)
    h.pv_q0 = h.pv_q1 = h.pv_q2 = h.samples = 0.0
    saturation.get_up(h)
    travel.pause(h)
    tag_mapping.unhook(h)


@jit
def _fade(h):
    """Halve all sums: what is two weeks old counts half, what is a month old a quarter."""
    h.since = 0.0
    h.wall_time, h.good_time, h.manual_time = 0.5 * h.wall_time, 0.5 * h.good_time, 0.5 * h.manual_time
    h.auto_time, h.abs_e, h.sum_e = 0.5 * h.auto_time, 0.5 * h.abs_e, 0.5 * h.sum_e
    h.mean_n, h.mean_1, h.mean_2 = 0.5 * h.mean_n, 0.5 * h.mean_1, 0.5 * h.mean_2
    saturation.fade(h)
    travel.fade(h)
    measurement.fade(h)
    tag_mapping.fade(h)
    harris.fade(h)


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


def figures(h: Any, s: Any, dead_time: float | None = None) -> Health:
    """Read a loop's health.

    Parameters
    ----------
    h, s
        Its running sums (dtype `HEALTH`) and its state (dtype `STATE`).
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
        out |= _of_control(h, auto, float(s["period"]))
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
