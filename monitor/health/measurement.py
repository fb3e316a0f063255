"""What PV's samples say of the way they were measured and stored: noise, resolution, frozen, compressed."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from monitor.compiled import jit

SMOOTH, UNWHITE = 0.5, 0.12
"""Largest share of second differences' variance that may be the process's, and by how much the autocorrelation at
lag 2 may lie below what white noise and a smooth process make; a random walk lies 0.25 below, a lag 0.2 and more."""
FROZEN = 30
"""Samples for which PV must be exactly the same to count as frozen, or idle if SP and OP rest too."""
UNUSUAL = 10.0
"""And that many times its usual stay at a value: a coarse PV dwells."""
LEAST_STUCK = 300
"""Samples for which it must rest once OP has begun to move: a dead time is none."""
MOVED = 6.0
"""Standard deviations of its noise that OP must have moved meanwhile."""
FIT, TRIES, FITTING = 0.02, 20.0, 0.95
"""A change of PV fits a step if it is a whole multiple within this; so many changes tell, of which so many must fit.
By chance, one in 25 fits."""
LOUD = 1.0
"""Logarithm of a block's variance above the mean logarithm, at most; that of noise has a standard deviation of 0.3."""
LOUDER = 8
"""Quiet blocks that are too loud, one after the other, after which the noise is another one, and learnt anew."""
RESTLESS = 0.1
"""Weight of a block in which an event ran: it counts where there is hardly another."""
FAR = 500.0
"""Steps in a change beyond which it tells nothing of the step."""
FINE = 0.05
"""A step below this share of the noise is the number format's, not the transmitter's."""
STRAIGHT = 1e-4
"""Second difference over first below which three values lie on a line: in noise, one in ten thousand does; a
response sampled 10,000 times in a time constant would."""
SAME = 3.0
"""Times that a change smaller than the step must be seen, more often than others, to be the step: once is a glitch."""
SHORT_STAY = 64
"""Samples of an unmoved PV that an archive's deadband may explain; longer, it rests."""
TELLS = 50.0
"""Pairs of changes, or stays, without which nothing is said of compression."""
WIDE = 50.0
"""Times the usual interval at which an interval is cut: a gap is no compression."""
QUANTILE = 0.1
"""Of the intervals: taken as the rate at which was sampled before compression."""

JITTER = 0.02
"""Relative difference of intervals that count as the same."""

_f, _i = np.float64, np.int64
FIELDS = [
    *[(n, _f) for n in ("pv_d", "pv_dd", "pv_dt", "pv_q0", "pv_q1", "pv_log", "pv_rho", "pv_known")],
    ("pv_loud", _f),
    *[(n, _f) for n in ("pv_older", "pv_q2", "pv_rho2")],
    *[
        (n, _f)
        for n in (
            "pv_step",
            "pv_tries",
            "pv_fits",
            "pv_changes",
            "pv_pairs",
            "pv_lines",
            "pv_small",
            "pv_same",
        )
    ],
    *[(n, _f) for n in ("pv_stays", "pv_stayed", "pv_n", "stuck_time", "idle_time", "still_op", "still_way")],
    *[(n, _f) for n in ("dt_low", "dt_sum", "dt_n")],
    ("pv_rest", _i),
    ("all_rest", _i),
    ("pv_seen", _i),
    ("still_run", _i),
]


@jit
def interval(h, dt):
    """Take in the time since the last sample, gap or not."""
    if h.pv_seen < 2:
        return  # an export's first value is its boundary's, at any distance
    if h.dt_low == 0.0:
        h.dt_low = dt
    h.dt_n += 1.0
    if abs(dt - h.dt_low) <= JITTER * dt:
        h.dt_sum += dt
        return
    weight = 0.05 if h.dt_n < 200.0 else 0.01
    if dt < h.dt_low:
        h.dt_low *= 1.0 - weight * (1.0 - QUANTILE)
    else:
        h.dt_low *= 1.0 + weight * QUANTILE
    h.dt_sum += min(dt, WIDE * h.dt_low)


@jit
def sense(h, last, dt, sp, pv, op):
    """Take in one good sample."""
    h.pv_seen += 1
    h.pv_n += 1.0
    d = pv - last.pv
    dd = d - h.pv_d
    h.pv_q0 += dd * dd
    h.pv_q1 += dd * h.pv_dd
    h.pv_q2 += dd * h.pv_older
    h.pv_older = h.pv_dd
    if d == 0.0:
        _still(h, last, dt, sp, op)
    else:
        if h.pv_rest > 0:
            if h.pv_rest <= SHORT_STAY:
                h.pv_stays += 1.0
                h.pv_stayed += h.pv_rest
            h.pv_rest = h.all_rest = 0
        if h.pv_changes == 0.0:
            h.stuck_time = 0.0  # it has never moved before: what it waited for was a dead time
        h.pv_changes += 1.0
        # one or a few steps of a coarse PV in a row are no line
        coarse = h.pv_tries < TRIES or h.pv_fits >= FITTING * h.pv_tries
        if h.pv_d != 0.0 and (abs(d) > 5.5 * h.pv_step or not coarse):
            h.pv_pairs += 1.0
            bend = abs(d * h.pv_dt - h.pv_d * dt)
            if bend <= STRAIGHT * abs(d) * h.pv_dt + 1e-15 * abs(pv) * dt:
                h.pv_lines += 1.0
        if h.pv_seen & 3 == 0 or h.pv_tries < TRIES:
            _step(h, abs(d), pv)
    h.pv_d, h.pv_dd, h.pv_dt = d, dd, dt


@jit
def _step(h, d, pv):
    """Whether a change is a whole multiple of the least one so far."""
    if d <= 1e-14 * abs(pv):
        return
    if h.pv_step == 0.0:
        h.pv_step = d
        return
    if d < 0.9 * h.pv_step:
        h.pv_tries += 1.0
        if abs(d - h.pv_small) < FIT * d:
            h.pv_same += 1.0
        elif h.pv_same > 1.0:
            h.pv_same -= 1.0
        else:
            h.pv_small, h.pv_same = d, 1.0
        if h.pv_same >= SAME:
            h.pv_step = d
            h.pv_small = h.pv_same = h.pv_tries = h.pv_fits = 0.0
        return
    r = d / h.pv_step
    if r < FAR:
        h.pv_tries += 1.0
        if abs(r - np.rint(r)) < FIT:
            h.pv_fits += 1.0


@jit
def _still(h, last, dt, sp, op):
    """Account for a sample at which PV is exactly what it was."""
    if h.pv_rest == 0:
        h.still_op, h.still_way, h.still_run = last.op, 0.0, 0
    h.pv_rest += 1
    n = h.pv_rest
    h.still_way = max(h.still_way, abs(op - h.still_op))
    if op == last.op and sp == last.sp:
        h.all_rest += 1
        if h.all_rest >= FROZEN:
            h.idle_time += dt * FROZEN if h.all_rest == FROZEN else dt
        return
    h.all_rest = 0
    if n < FROZEN or h.still_way <= MOVED * h.op_noise or h.still_way < 0.05 * (h.op_max - h.op_min):
        return
    h.still_run += 1
    if h.still_run < LEAST_STUCK:
        return
    usual = (h.pv_n - n) / (h.pv_changes + 1.0)
    if n > UNUSUAL * usual:
        h.stuck_time += dt


@jit
def weigh_noise(h, n, quiet):
    """At the end of a block of ``n`` samples: learn from its second differences; a quiet block has the most weight."""
    q0, q1, q2 = h.pv_q0 / n, h.pv_q1 / n, h.pv_q2 / n
    h.pv_q0 = h.pv_q1 = h.pv_q2 = 0.0
    if q0 > 0.0:
        weight = 1.0 if quiet else RESTLESS
        loudness = np.log(q0)
        h.pv_loud = run_of_loud(h.pv_loud, loudness, h.pv_log, h.pv_known, quiet)
        if h.pv_loud >= LOUDER:
            h.pv_log = h.pv_rho = h.pv_rho2 = h.pv_known = h.pv_loud = 0.0
        h.pv_log += weight * clipped(loudness, h.pv_log, h.pv_known)
        h.pv_known += weight
        h.pv_rho += weight * q1 / q0
        h.pv_rho2 += weight * q2 / q0


@jit
def clipped(value, total, n):
    """Cut what lies far above the mean so far: a block with a step in it."""
    return min(value, total / n + LOUD) if n >= 1.0 else value


@jit
def run_of_loud(run, value, total, n, counts):
    """Return how many blocks in a row were cut, this one too; one that does not count ends no run."""
    if value <= clipped(value, total, n):
        return 0.0
    return run + 1.0 if counts else run


@jit
def blink(h):
    """Forget what ran, after a gap."""
    h.pv_rest = h.all_rest = 0
    h.pv_d = h.pv_dd = h.pv_older = h.pv_q0 = h.pv_q1 = h.pv_q2 = 0.0


@jit
def fade(h):
    """Halve the sums."""
    h.pv_log *= 0.5
    h.pv_rho *= 0.5
    h.pv_rho2 *= 0.5
    h.pv_known *= 0.5
    h.pv_tries *= 0.5
    h.pv_fits *= 0.5
    h.pv_changes *= 0.5
    h.pv_pairs *= 0.5
    h.pv_lines *= 0.5
    h.pv_stays *= 0.5
    h.pv_stayed *= 0.5
    h.pv_n *= 0.5
    h.stuck_time *= 0.5
    h.idle_time *= 0.5
    h.dt_sum *= 0.5
    h.dt_n *= 0.5


def noise_of(h: Any) -> float | None:
    """Return the standard deviation of PV's white noise [PV], None where it is not white at this sampling.

    Second differences see noise and little of the process: their variance is 6 sigma^2, their autocorrelation at lags
    1 and 2 is -2/3 and 1/6; a smooth process adds a share with 1 and 1, by which we know it. Derived; holds for the
    loop's own sampling. The blocks' geometric mean is what a quiet block shows: steps are few.
    """
    n = float(h["pv_known"])
    if n <= 0.0:
        return None
    share = max((float(h["pv_rho"]) / n + 2.0 / 3.0) / (5.0 / 3.0), 0.0)
    if share > SMOOTH or float(h["pv_rho2"]) / n < 1.0 / 6.0 + share * 5.0 / 6.0 - UNWHITE:
        return None
    return math.sqrt(math.exp(float(h["pv_log"]) / n) * (1.0 - share) / 6.0)


def quantum_of(h: Any) -> float | None:
    """Return the step of which all changes of PV are multiples [PV]; None if there is none, or none that matters."""
    step = float(h["pv_step"])
    if step <= 0.0 or h["pv_tries"] < TRIES or h["pv_fits"] < FITTING * h["pv_tries"]:
        return None
    n = float(h["pv_known"])
    usual = math.sqrt(math.exp(float(h["pv_log"]) / n) / 6.0) if n > 0 else 0.0
    return step if step > FINE * usual else None


def compression_of(h: Any) -> float | None:
    """Return the share of PV's values that an archive left out or made up, 0 to 1: 1 - 1/ratio of compression.

    The largest of: values exactly on the line through their neighbours (N. F. Thornhill, M. A. A. S. Choudhury,
    S. L. Shah, J. Process Control 14 (2004) 389-398), values held over some samples though PV has no step of its own,
    and intervals longer than the shortest usual ones (raw archive data). None with too little data.
    """
    if h["dt_n"] < TELLS:
        return None
    lines = stays = 0.0
    if h["pv_pairs"] >= TELLS:
        lines = float(h["pv_lines"] / h["pv_pairs"])
    if h["pv_stays"] >= TELLS and quantum_of(h) is None:
        stays = float(h["pv_stayed"] / h["pv_n"])
    left_out = max(1.0 - float(h["dt_low"] * h["dt_n"] / h["dt_sum"]), 0.0) if h["dt_sum"] > 0 else 0.0
    return min(max(lines, stays, left_out), 1.0)
