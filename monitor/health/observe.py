"""What a loop's samples say of its health, beside its events: one call a sample, one look at the figures.

`observe` takes in one good sample, compiled, in O(1) memory a loop (about 5 kB); what needs more than a few
additions is done in blocks of 64 samples. `figures` reads the sums. Sums are halved every two weeks, so a monitor
speaks of the recent ones. A figure that the data cannot carry is None.
"""

from __future__ import annotations

import numpy as np

from monitor.compiled import jit
from monitor.detect.state import EVENT, QUIET, SETPOINT_STEP

from . import autocorrelation, harris, measurement, saturation, tag_mapping, travel
from .autocorrelation import BLOCK, HORIZON, restart, space, taint, take

CASCADE = 0.2
"""Share of samples at which SP moves, above which no single move of it is a disturbance."""
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
        *autocorrelation.FIELDS,
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
