"""Whether a sample counts, and how a loop's samples come: late, in gaps, at which period (compiled)."""

from __future__ import annotations

import numpy as np

from monitor.compiled import jit
from monitor.contract.samples import QUALITY_GOOD, QUALITY_UNCERTAIN

from .state import COARSE, MAX_GAP, REBASE, REGAP, RING, TOO_LARGE, WARM_UP


@jit
def remember(s, i, ring, ring_time, coarse, coarse_time, time, sp, pv, op):
    """Put a sample into the loop's rings."""
    j = s.ringed & (RING - 1)
    ring_time[i, j] = time
    ring[i, j, 0], ring[i, j, 1], ring[i, j, 2] = sp, pv, op
    j = (s.ringed // COARSE) & (RING - 1)
    b = s.ringed % COARSE
    if b == 0:
        coarse_time[i, j] = time
        coarse[i, j, 0], coarse[i, j, 1], coarse[i, j, 2] = sp, pv, op
    else:  # OP held from point to point is its mean
        coarse[i, j, 2] += (op - coarse[i, j, 2]) / (b + 1)
    s.ringed += 1


@jit
def accepted(s, p, time, sp, pv, op, quality):
    """Count a sample; True if it is good and newer than the loop's last."""
    if s.seen > 0 and time <= s.time:
        if time == s.time:
            s.duplicate += 1
            if pv != s.pv or sp != s.sp or op != s.op:
                s.conflict += 1
            return False
        if not _set_back(s, time):
            s.late += 1
            return False
    if quality < QUALITY_UNCERTAIN:
        s.bad_quality += 1
        s.spoilt += 1
        return False
    ok = p.pv_min < pv < p.pv_max and p.pv_min < sp < p.pv_max and abs(op) < TOO_LARGE
    if not ok:  # also NaN
        s.bad_value += 1
        s.spoilt += 1
        return False
    s.ok += 1
    if quality < QUALITY_GOOD:
        s.uncertain += 1
    s.lates = s.spoilt = 0
    return True


@jit
def _set_back(s, time):
    """Whether a late sample is one of so many, each soon after the last, that the source's clock was set back."""
    soon = 0 < time - s.late_at <= MAX_GAP * s.period * 1e9
    s.lates = s.lates + 1 if soon else 1
    s.late_at = time
    return s.lates > REBASE


@jit
def count_gaps(s, time, dt, gap, back):
    """Take gaps for the sample period where there is nothing else, and a clock that was set back for what it is."""
    if back:
        s.rebased += 1
        s.moved = time
        return
    s.gaps = s.gaps + 1 if gap else 0
    s.least_gap = dt if s.gaps <= 1 else min(s.least_gap, dt)
    if s.gaps >= REGAP:
        s.period = s.least_gap
        s.gaps = 0


@jit
def other_units(s, sp, pv):
    """Whether SP and PV jump together, as no process does: other units, or another tag. The error stays small."""
    step = sp - s.sp
    return abs(step) > 10.0 * np.sqrt(s.var_e) and abs(pv - s.pv - step) <= 0.1 * abs(step)


@jit
def keep_last(s, time, sp, pv, op, auto):
    """Make this sample the last one."""
    d = pv - s.pv
    if s.seen > 0 and d != 0.0 and (s.quantum == 0.0 or abs(d) < s.quantum):
        s.quantum = abs(d)
    s.dpv = d
    s.time, s.sp, s.pv, s.op, s.auto = time, sp, pv, op, 1 if auto else 0
    s.seen += 1


@jit
def _median_step(ring_time, i, ringed):
    """Sample period where none is given: the median step between the ring's times [s]."""
    m = min(ringed, RING)
    steps = np.empty(m - 1)
    for j in range(m - 1):
        steps[j] = (ring_time[i, (ringed - m + j + 1) % RING] - ring_time[i, (ringed - m + j) % RING]) * 1e-9
    return np.median(steps)


@jit
def follow_rate(s, p, ring_time, i):
    """Take over the sample period as it is now, unless it is given; what averages knew of another is worth nothing."""
    if p.period != 0 and s.period == p.period:
        return
    period = max(_median_step(ring_time, i, s.ringed), p.period)
    if abs(period - s.period) > 0.2 * period and s.slot < 0:
        s.warm = s.based = s.away = s.looks = 0
        s.learn = WARM_UP
    s.period = period
