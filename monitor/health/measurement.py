"""What PV's samples say of the way they were measured and stored: noise, resolution, frozen, compressed."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from monitor.compiled import jit, jit_inlined

from .fields import clearing, halving
from .variance_jump import VARIANCE_JUMP_BLOCKS, blocks_in_jump, clipped

SMOOTH_SHARE, UNWHITE_ACF = 0.5, 0.12
"""Largest share of second differences' variance that may be the process's, and by how much the autocorrelation at
lag 2 may lie below what white noise and a smooth process make; a random walk lies 0.25 below, a lag 0.2 and more."""
FROZEN_SAMPLES = 30
"""Samples for which PV must be exactly the same to count as frozen, or idle if SP and OP rest too."""
UNUSUAL_STAYS = 10.0
"""And that many times its usual stay at a value: a coarse PV dwells."""
STUCK_SAMPLES = 300
"""Samples for which it must rest once OP has begun to move: a dead time is none."""
OP_MOVED_SD, OP_MOVED_SHARE = 6.0, 0.05
"""Standard deviations of its noise that OP must have moved meanwhile, and the share of its range."""
FIT_STEPS, FIT_CHANGES, FIT_SHARE = 0.02, 20.0, 0.95
"""A change of PV fits a step if it is a whole multiple within this; so many changes tell, of which this share must
fit. By chance, one in 25 fits."""
STUCK_TIME_SHARE, IDLE_TIME_SHARE = 0.05, 0.8
"""Shares of the time from which on a frozen PV counts, and a loop is called idle."""
EVENTFUL_WEIGHT = 0.1
"""Weight of a block in which an event ran: it counts where there is hardly another."""
FAR_STEPS = 500.0
"""Steps in a change beyond which it tells nothing of the step."""
FORMAT_SD = 0.05
"""A step below this share of the noise is the number format's, not the transmitter's."""
STRAIGHT_SHARE = 1e-4
"""Second difference over first below which three values lie on a line: in noise, one in ten thousand does; a
response sampled 10,000 times in a time constant would."""
SINGLE_STEPS = 5.5
"""Steps of a coarse PV up to which a change is no part of a line: one or a few in a row are none."""
SMALLER_STEPS, SMALLER_CHANGES = 0.9, 3.0
"""A change below this share of the step is a smaller one; times that it must be seen, more often than others, to be
the step: once is a glitch."""
STAY_SAMPLES = 64
"""Samples of an unmoved PV that an archive's deadband may explain; longer, it rests."""
ARCHIVE_COUNT = 50.0
"""Intervals, pairs of changes, or stays, without which they say nothing of compression."""
GAP_INTERVALS = 50.0
"""Times the usual interval at which an interval is cut: a gap is no compression."""
INTERVAL_QUANTILE = 0.1
"""Of the intervals: taken as the rate at which was sampled before compression."""
EARLY_INTERVALS, EARLY_WEIGHT, LATE_WEIGHT = 200.0, 0.05, 0.01
"""Share by which one interval moves that quantile: fast for so many intervals, slowly afterwards."""
JITTER_SHARE = 0.02
"""Relative difference of intervals that count as the same."""

SUMS: list[Any] = [
    # noise: over blocks of 64 samples, each with its weight
    ("log_variance", "f8"),  # ln of the mean square of second differences [ln PV^2]
    ("acf_1", "f8"),  # autocorrelation of second differences at lag 1
    ("acf_2", "f8"),  # and at lag 2
    ("blocks", "f8"),  # weights
    # the transmitter's step
    ("tries", "f8"),  # changes held against the step
    ("fits", "f8"),  # whole multiples of it among them
    # frozen, idle
    ("samples", "f8"),
    ("changes", "f8"),  # samples at which PV is another
    ("stuck_time", "f8"),  # [s] at rest while OP moves
    ("idle_time", "f8"),  # [s] at rest like SP and OP
    # compression
    ("pairs", "f8"),  # two changes, one after the other
    ("lines", "f8"),  # those that lie on a line
    ("stays", "f8"),  # short rests that are over
    ("stayed", "f8"),  # samples in these
    ("interval_time", "f8"),  # [s] intervals between samples, long ones cut
    ("intervals", "f8"),
]
BLOCK_SUMS: list[Any] = [
    ("squares", "f8"),  # [PV^2] second differences of the block that fills, squared
    ("products_1", "f8"),  # [PV^2] times the one before
    ("products_2", "f8"),  # [PV^2] times the last but one
]
RUNNING: list[Any] = [
    *BLOCK_SUMS,
    ("change", "f8"),  # [PV] last difference
    ("change_time", "f8"),  # [s] in which it came
    ("bend", "f8"),  # [PV] last second difference
    ("older_bend", "f8"),  # [PV] and the one before
    ("rest", "i8"),  # samples for which PV has been exactly the same
    ("all_rest", "i8"),  # and SP and OP too
    ("op_from", "f8"),  # [OP] when PV came to rest
    ("op_moved", "f8"),  # [OP] furthest from there
    ("op_moved_rest", "i8"),  # samples of rest since OP has moved
]
KEPT: list[Any] = [
    ("jump", "f8"),  # quiet blocks in a row with too large a variance
    ("step", "f8"),  # [PV] of which all changes are multiples, 0 before any
    ("smaller", "f8"),  # [PV] a change below it
    ("smaller_seen", "f8"),  # times that it was seen, less the times that others were
    ("interval", "f8"),  # [s] short interval between samples, 0 before any
    ("seen", "i8"),  # samples ever
]
DTYPE = np.dtype([*SUMS, *RUNNING, *KEPT])

decay = halving(SUMS)
reset = clearing(RUNNING)
reset_block = clearing(BLOCK_SUMS)


@jit_inlined
def update_interval(own, dt):
    """Take in the time since the last sample [s], gap or not."""
    if own.seen < 2:
        return  # an export's first value is its boundary's, at any distance
    if own.interval == 0.0:
        own.interval = dt
    own.intervals += 1.0
    if abs(dt - own.interval) <= JITTER_SHARE * dt:
        own.interval_time += dt
        return
    weight = EARLY_WEIGHT if own.intervals < EARLY_INTERVALS else LATE_WEIGHT
    if dt < own.interval:
        own.interval *= 1.0 - weight * (1.0 - INTERVAL_QUANTILE)
    else:
        own.interval *= 1.0 + weight * INTERVAL_QUANTILE
    own.interval_time += min(dt, GAP_INTERVALS * own.interval)


@jit_inlined
def update(own, last, dt, sp, pv, op, op_noise, op_range):
    """Take in one good sample.

    Parameters
    ----------
    last
        The sample before: sp, pv, op.
    dt
        Time between them [s].
    sp, pv, op
        The sample.
    op_noise, op_range
        Standard deviation of OP's noise and its range so far [OP]: what counts as its having moved.
    """
    own.seen += 1
    own.samples += 1.0
    d = pv - last.pv
    dd = d - own.change
    own.squares += dd * dd
    own.products_1 += dd * own.bend
    own.products_2 += dd * own.older_bend
    own.older_bend = own.bend
    if d == 0.0:
        _rest(own, last, dt, sp, op, op_noise, op_range)
    else:
        if own.rest > 0:
            if own.rest <= STAY_SAMPLES:
                own.stays += 1.0
                own.stayed += own.rest
            own.rest = own.all_rest = 0
        if own.changes == 0.0:
            own.stuck_time = 0.0  # it has never moved before: what it waited for was a dead time
        own.changes += 1.0
        # one or a few steps of a coarse PV in a row are no line
        coarse = own.tries < FIT_CHANGES or own.fits >= FIT_SHARE * own.tries
        if own.change != 0.0 and (abs(d) > SINGLE_STEPS * own.step or not coarse):
            own.pairs += 1.0
            bend = abs(d * own.change_time - own.change * dt)
            if bend <= STRAIGHT_SHARE * abs(d) * own.change_time + 1e-15 * abs(pv) * dt:
                own.lines += 1.0
        if own.seen & 3 == 0 or own.tries < FIT_CHANGES:
            _step(own, abs(d), pv)
    own.change, own.bend, own.change_time = d, dd, dt


@jit
def _step(own, d, pv):
    """Whether a change is a whole multiple of the least one so far."""
    if d <= 1e-14 * abs(pv):
        return
    if own.step == 0.0:
        own.step = d
        return
    if d < SMALLER_STEPS * own.step:
        own.tries += 1.0
        if abs(d - own.smaller) < FIT_STEPS * d:
            own.smaller_seen += 1.0
        elif own.smaller_seen > 1.0:
            own.smaller_seen -= 1.0
        else:
            own.smaller, own.smaller_seen = d, 1.0
        if own.smaller_seen >= SMALLER_CHANGES:
            own.step = d
            own.smaller = own.smaller_seen = own.tries = own.fits = 0.0
        return
    r = d / own.step
    if r < FAR_STEPS:
        own.tries += 1.0
        if abs(r - np.rint(r)) < FIT_STEPS:
            own.fits += 1.0


@jit
def _rest(own, last, dt, sp, op, op_noise, op_range):
    """Account for a sample at which PV is exactly what it was."""
    if own.rest == 0:
        own.op_from, own.op_moved, own.op_moved_rest = last.op, 0.0, 0
    own.rest += 1
    n = own.rest
    own.op_moved = max(own.op_moved, abs(op - own.op_from))
    if op == last.op and sp == last.sp:
        own.all_rest += 1
        if own.all_rest >= FROZEN_SAMPLES:
            own.idle_time += dt * FROZEN_SAMPLES if own.all_rest == FROZEN_SAMPLES else dt
        return
    own.all_rest = 0
    if (
        n < FROZEN_SAMPLES
        or own.op_moved <= OP_MOVED_SD * op_noise
        or own.op_moved < OP_MOVED_SHARE * op_range
    ):
        return
    own.op_moved_rest += 1
    if own.op_moved_rest < STUCK_SAMPLES:
        return
    usual = (own.samples - n) / (own.changes + 1.0)
    if n > UNUSUAL_STAYS * usual:
        own.stuck_time += dt


@jit
def update_block(own, n, quiet):
    """Learn from the second differences of a block of ``n`` samples; a quiet block has the most weight."""
    q0, q1, q2 = own.squares / n, own.products_1 / n, own.products_2 / n
    reset_block(own)
    if q0 > 0.0:
        weight = 1.0 if quiet else EVENTFUL_WEIGHT
        variance = np.log(q0)
        own.jump = blocks_in_jump(own.jump, variance, own.log_variance, own.blocks, quiet)
        if own.jump >= VARIANCE_JUMP_BLOCKS:
            own.log_variance = own.acf_1 = own.acf_2 = own.blocks = own.jump = 0.0
        own.log_variance += weight * clipped(variance, own.log_variance, own.blocks)
        own.blocks += weight
        own.acf_1 += weight * q1 / q0
        own.acf_2 += weight * q2 / q0


def noise_of(own: Any) -> float | None:
    """Return the standard deviation of PV's white noise [PV], None where it is not white at this sampling.

    Second differences see noise and little of the process: their variance is 6 sigma^2, their autocorrelation at lags
    1 and 2 is -2/3 and 1/6; a smooth process adds a share with 1 and 1, by which we know it. Derived; holds for the
    loop's own sampling. The blocks' geometric mean is what a quiet block shows: steps are few.
    """
    n = float(own["blocks"])
    if n <= 0.0:
        return None
    share = max((float(own["acf_1"]) / n + 2.0 / 3.0) / (5.0 / 3.0), 0.0)
    if share > SMOOTH_SHARE or float(own["acf_2"]) / n < 1.0 / 6.0 + share * 5.0 / 6.0 - UNWHITE_ACF:
        return None
    return math.sqrt(math.exp(float(own["log_variance"]) / n) * (1.0 - share) / 6.0)


def quantum_of(own: Any) -> float | None:
    """Return the step of which all changes of PV are multiples [PV]; None if there is none, or none that matters."""
    step = float(own["step"])
    if step <= 0.0 or own["tries"] < FIT_CHANGES or own["fits"] < FIT_SHARE * own["tries"]:
        return None
    n = float(own["blocks"])
    usual = math.sqrt(math.exp(float(own["log_variance"]) / n) / 6.0) if n > 0 else 0.0
    return step if step > FORMAT_SD * usual else None


def moving_of(own: Any) -> float | None:
    """Return the share of samples at which PV was another than before, None before any."""
    return float(own["changes"]) / float(own["samples"]) if own["samples"] > 0 else None


def compression_of(own: Any) -> float | None:
    """Return the share of PV's values that an archive left out or made up, 0 to 1: 1 - 1/ratio of compression.

    The largest of: values exactly on the line through their neighbours (N. F. Thornhill, M. A. A. S. Choudhury,
    S. L. Shah, J. Process Control 14 (2004) 389-398), values held over some samples though PV has no step of its own,
    and intervals longer than the shortest usual ones (raw archive data). None with too little data.
    """
    if own["intervals"] < ARCHIVE_COUNT:
        return None
    lines = stays = 0.0
    if own["pairs"] >= ARCHIVE_COUNT:
        lines = float(own["lines"] / own["pairs"])
    if own["stays"] >= ARCHIVE_COUNT and quantum_of(own) is None:
        stays = float(own["stayed"] / own["samples"])
    left_out = 0.0
    if own["interval_time"] > 0:
        left_out = max(1.0 - float(own["interval"] * own["intervals"] / own["interval_time"]), 0.0)
    return min(max(lines, stays, left_out), 1.0)


def is_stuck(own: Any, good_time: float) -> bool:
    """Whether PV was exactly the same for long while OP moved, in the time that was watched [s]."""
    return bool(own["stuck_time"] > STUCK_TIME_SHARE * good_time)


def is_idle(own: Any, good_time: float) -> bool:
    """Whether PV, SP and OP rest nearly always in the time that was watched [s]."""
    return bool(own["idle_time"] > IDLE_TIME_SHARE * good_time)
