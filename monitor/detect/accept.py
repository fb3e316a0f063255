"""Whether a sample counts, and how a loop's samples come: late, in gaps, at which period (compiled)."""

from __future__ import annotations

import numpy as np

from monitor.by_size import median_of
from monitor.compiled import jit
from monitor.contract.samples import QUALITY_GOOD, QUALITY_UNCERTAIN

from .constants import (
    COARSE_SAMPLES,
    MAX_GAP_PERIODS,
    NEW_PERIOD_GAPS,
    RING_SAMPLES,
    SET_BACK_SAMPLES,
    TOO_LARGE,
    WARM_UP_SAMPLES,
)


@jit
def remember(s, rings, time, sp, pv, op):
    """Put a sample into the loop's rings."""
    j = s.ring_n & (RING_SAMPLES - 1)
    values, coarse = rings.values, rings.coarse
    rings.time[j] = time
    values[j, 0], values[j, 1], values[j, 2] = sp, pv, op
    j = (s.ring_n // COARSE_SAMPLES) & (RING_SAMPLES - 1)
    b = s.ring_n % COARSE_SAMPLES
    if b == 0:
        rings.coarse_time[j] = time
        coarse[j, 0], coarse[j, 1], coarse[j, 2] = sp, pv, op
    else:  # OP held from point to point is its mean
        coarse[j, 2] += (op - coarse[j, 2]) / (b + 1)
    s.ring_n += 1


@jit
def accepted(s, p, time, sp, pv, op, quality):
    """Count a sample; True if it is good and newer than the loop's last."""
    last, counts, clock = s.last, s.counts, s.clock
    if counts.ok > 0 and time <= last.time:
        if time == last.time:
            counts.duplicate += 1
            if pv != last.pv or sp != last.sp or op != last.op:
                counts.conflict += 1
            return False
        if not _set_back(clock, time):
            counts.late += 1
            return False
    if quality < QUALITY_UNCERTAIN:
        counts.bad_quality += 1
        clock.bad_run += 1
        return False
    ok = p.pv_min < pv < p.pv_max and p.pv_min < sp < p.pv_max and abs(op) < TOO_LARGE
    if not ok:  # also NaN
        counts.bad_value += 1
        clock.bad_run += 1
        return False
    counts.ok += 1
    if quality < QUALITY_GOOD:
        counts.uncertain += 1
    clock.late_run = clock.bad_run = 0
    return True


@jit
def _set_back(clock, time):
    """Whether a late sample is one of so many, each soon after the last, that the source's clock was set back."""
    soon = 0 < time - clock.late_at <= MAX_GAP_PERIODS * clock.period * 1e9
    clock.late_run = clock.late_run + 1 if soon else 1
    clock.late_at = time
    return clock.late_run > SET_BACK_SAMPLES


@jit
def count_gaps(s, time, dt, gap, back):
    """Take gaps for the sample period where there is nothing else, and a clock that was set back for what it is."""
    clock = s.clock
    if back:
        clock.set_back += 1
        s.setpoint.moved_at = time
        return
    clock.gap_run = clock.gap_run + 1 if gap else 0
    clock.least_gap = dt if clock.gap_run <= 1 else min(clock.least_gap, dt)
    if clock.gap_run >= NEW_PERIOD_GAPS:
        clock.period = clock.least_gap
        clock.gap_run = 0


@jit
def other_units(s, sp, pv):
    """Whether SP and PV jump together, as no process does: other units, or another tag. The error stays small."""
    step = sp - s.last.sp
    known = s.noise.n >= WARM_UP_SAMPLES
    return (
        known
        and abs(step) > 10.0 * np.sqrt(s.noise.now.var_e)
        and abs(pv - s.last.pv - step) <= 0.1 * abs(step)
    )


@jit
def keep_last(s, time, sp, pv, op, auto):
    """Make this sample the last one."""
    last, noise = s.last, s.noise
    d = pv - last.pv
    if s.counts.ok > 1 and d != 0.0 and (noise.quantum == 0.0 or abs(d) < noise.quantum):
        noise.quantum = abs(d)
    last.pv_change = d
    last.time, last.sp, last.pv, last.op, last.auto = time, sp, pv, op, 1 if auto else 0


@jit
def _median_step(time, ring_n):
    """Sample period where none is given: the median step between the ring's times [s]."""
    m = min(ring_n, RING_SAMPLES)
    steps = np.empty(m - 1)
    for j in range(m - 1):
        later = time[(ring_n - m + j + 1) % RING_SAMPLES]
        steps[j] = (later - time[(ring_n - m + j) % RING_SAMPLES]) * 1e-9
    return median_of(steps)


@jit
def follow_rate(s, p, rings):
    """Take over the sample period as it is now, unless it is given; what averages knew of another is worth nothing."""
    if p.period != 0 and s.clock.period == p.period:
        return
    period = max(_median_step(rings.time, s.ring_n), p.period)
    if abs(period - s.clock.period) > 0.2 * period and s.window.slot < 0:
        s.noise.n = s.baseline.n = s.noise.outside_run = s.noise.snapshots = 0
        s.noise.least_n = WARM_UP_SAMPLES
    s.clock.period = period
