"""What a loop's samples say of its health, beside its events: one call a sample, one look at the figures.

`observe` takes in one good sample, compiled, in O(1) memory a loop (about 5 kB); what needs more than a few
additions is done in blocks of 64 samples. `figures` reads the sums. Sums are halved every two weeks, so a monitor
speaks of the recent ones. A figure that the data cannot carry is None.
"""

from __future__ import annotations

import numpy as np

from monitor.compiled import jit

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
def observe(h, last, period, limits, dt, gap, sp, pv, op, auto, quiet, stepping):
    """Account for one good sample.

    Parameters
    ----------
    h
        The loop's record, of dtype `HEALTH`.
    last
        The sample before: sp, pv, op, auto.
    period
        Sample period [s], 0 before it is known.
    limits
        Of OP: op_low, op_high, infinite where there is none.
    dt
        Time since the last sample [s].
    gap
        Whether nothing may be carried across that time.
    sp, pv, op, auto
        The sample.
    quiet
        Whether no event, and nothing like one, goes on.
    stepping
        Whether the loop answers to a step of its set point.
    """
    h.wall_time += dt
    measurement.interval(h, dt)
    if gap:
        measurement.blink(h)
        _interrupt(h)
        return
    # a missed sample is bridged, but does not count as covered
    h.good_time += dt if period == 0 else min(dt, 1.5 * period)
    if not last.auto:
        h.manual_time += dt
    measurement.sense(h, last, dt, sp, pv, op)
    if not last.auto or not auto:
        _interrupt(h)
        return
    before, e = last.sp - last.pv, sp - pv
    h.auto_time += dt
    h.abs_e += abs(before) * dt
    h.sum_e += before * dt
    saturation.rest(h, last, limits, dt, op, e != before)
    travel.move(h, last, period, dt, op)
    tag_mapping.trace(h, last, e, sp, pv, op)
    if sp != last.sp and h.w_sp < CASCADE * h.w_n + 1.0:
        taint(h)
    if period <= 0.0:
        return
    space(h, period)
    h.samples += 1.0
    h.clock += dt
    n = int(h.clock / h.spacing + 0.5)
    h.clock -= n * h.spacing
    for _ in range(min(n, MOST_MISSED + 1)):
        clean = h.tainted & 1 == 0
        take(h, e)
        if h.taken & (BLOCK - 1) == 0:
            _block(h, clean and not stepping, quiet, BLOCK * h.spacing)


@jit
def _block(h, clean, quiet, seconds):
    """Do what is done once in 64 samples; ``clean``: nothing in them comes from a step of the set point."""
    travel.weigh_moves(h, h.samples)
    measurement.weigh_noise(h, h.samples, quiet)
    h.samples = 0.0
    if clean:
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
