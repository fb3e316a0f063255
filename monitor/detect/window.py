"""The compiled life of an event's window: opened, its integrals carried, thinned when full, handed out.

``s`` is one loop's state, ``slab`` holds the windows. Types are inferred by numba.
"""

from __future__ import annotations

import numpy as np

from monitor.compiled import jit

from .event import LOAD_STEP, SETPOINT_STEP
from .state import CANDIDATE, CLOSED, COARSE, EVENT, LEAST_BEFORE, OPENED, RING, WARM_UP, WINDOW


@jit
def begin(s, ring, ring_time, slab, free, n_free, i, time):
    """Open a window for a set point that has begun to move; the integrals start here."""
    s.phase = CANDIDATE
    s.kind = SETPOINT_STEP
    s.onset = time
    s.ok_before, s.uncertain_before = s.ok, s.uncertain
    n_free[0] -= 1
    s.slot = free[n_free[0]]
    s.s1 = s.s2 = s.s3 = s.y1 = s.y2 = s.iae = s.iae_noise = s.good_time = s.saturated_time = 0.0
    based = s.based >= WARM_UP // 2
    s.pv0 = s.mean_pv if based else s.pv
    s.op0 = s.mean_op if based else s.op
    s.error_sd, s.noise = np.sqrt(s.var_e), np.sqrt(s.var_d / 6.0)
    s.quiet = 1.0 if s.based >= WARM_UP and s.away == 0 else 0.0
    # what lies before the loop came to rest belongs to another event
    m = min(s.ringed, RING, max(s.based if s.away == 0 else 0, LEAST_BEFORE))
    w = slab[s.slot]
    for j in range(m):
        k = (s.ringed - m + j) % RING
        w[j, 0] = (ring_time[i, k] - time) * 1e-9
        w[j, 1], w[j, 2], w[j, 3] = ring[i, k, 0], ring[i, k, 1], ring[i, k, 2]
    s.points = s.before = m
    s.stride = 1
    s.skipped = 0


@jit
def begin_load(s, ring, ring_time, coarse, coarse_time, slab, i, time, pv):
    """Turn the window just opened into a suspected load step's; it and the integrals reach back to quiet times.

    The step came before it was noticed: the onset is found when the event is assessed. Nothing is reported
    until then.
    """
    s.phase = EVENT
    s.kind = LOAD_STEP
    s.events += 1
    # the noise of before the response
    s.mean_e, s.var_e, s.abs_e, s.mean_s, s.var_s = s.mean_e_2, s.var_e_2, s.abs_e_2, s.mean_s_2, s.var_s_2
    s.error_sd = np.sqrt(s.var_e)
    s.amplitude = abs(s.short - s.mean_s)
    restart_settling(s, time)
    s.waves = s.side = 0
    w = slab[s.slot]
    reach = s.based + s.away
    first = ((s.ringed - min(s.ringed, RING, reach) + COARSE - 1) // COARSE) * COARSE  # of the fine points
    n = 0
    quiet = max((s.ringed - reach + COARSE - 1) // COARSE, s.ringed // COARSE - RING + 1, 0)
    for k in range(quiet, first // COARSE):
        j = k & (RING - 1)
        w[n, 0] = (coarse_time[i, j] - time) * 1e-9
        w[n, 1], w[n, 2], w[n, 3] = coarse[i, j, 0], coarse[i, j, 1], coarse[i, j, 2]
        n += 1
    for k in range(first, s.ringed):
        j = k & (RING - 1)
        w[n, 0] = (ring_time[i, j] - time) * 1e-9
        w[n, 1], w[n, 2], w[n, 3] = ring[i, j, 0], ring[i, j, 1], ring[i, j, 2]
        n += 1
    s.points = s.before = n
    s.pv0 = s.op0 = 0.0
    for k in range(n // 2):
        s.pv0 += w[k, 2] / (n // 2)
        s.op0 += w[k, 3] / (n // 2)
    for k in range(n - 1):
        add(s, w[k, 1], w[k, 2], w[k + 1, 2], w[k, 3], w[k + 1, 0] - w[k, 0])
    add(s, s.sp, s.pv, pv, s.op, (time - s.time) * 1e-9)


@jit
def restart_settling(s, time):
    """Begin anew to watch whether the error lies still."""
    s.still = time
    s.low = s.high = s.short
    s.sum_e = s.sum_t = 0.0


@jit
def confirm(s, out, n, i, time, sp):
    """Report that an event has opened: the set point rests at a new level."""
    s.phase = EVENT
    s.events += 1
    s.held = sp
    restart_settling(s, time)
    s.waves = s.side = 0
    o = out[n]
    o.kind = SETPOINT_STEP
    o.what, o.row, o.slot = OPENED, i, -1
    o.onset, o.number, o.amplitude = s.onset, s.events, s.amplitude
    return n + 1


@jit
def drop(s, free, n_free):
    """Forget a window: its slot is free again."""
    free[n_free[0]] = s.slot
    n_free[0] += 1
    s.slot = -1


@jit
def add(s, sp, pv_old, pv_new, op, dt):
    """Carry the running integrals over one sample (set-point and load forms share them).

    OP is held: left rectangles; PV and the integrals of integrals: trapezoids. SP is held as well, so the
    error's trapezoid ends with the old set point.
    """
    u = op - s.op0
    y_old, y_new = pv_old - s.pv0, pv_new - s.pv0
    s1 = s.s1 + u * dt
    s2 = s.s2 + 0.5 * (s.s1 + s1) * dt
    s.s3 += 0.5 * (s.s2 + s2) * dt
    s.s1, s.s2 = s1, s2
    y1 = s.y1 + 0.5 * (y_old + y_new) * dt
    s.y2 += 0.5 * (s.y1 + y1) * dt
    s.y1 = y1
    area = 0.5 * (abs(sp - pv_old) + abs(sp - pv_new)) * dt
    s.iae += area
    if abs(s.short - s.mean_e) < 2.0 * s.error_sd:
        s.iae_noise += min(area, s.abs_e * dt)  # nothing but noise is left here


@jit
def append(s, slab, time, sp, pv, op):
    """Put the sample into the window; OP of a skipped sample goes, by time, into the last point's mean."""
    w = slab[s.slot]
    t = (time - s.onset) * 1e-9
    last = s.points - 1
    if s.skipped > 0:
        # w[last, 3] holds the mean OP from the last point to s.time; s.op was held since
        before = (s.time - s.onset) * 1e-9 - w[last, 0]
        whole = t - w[last, 0]
        w[last, 3] = (w[last, 3] * before + s.op * (whole - before)) / whole
    s.skipped += 1
    if s.skipped < s.stride:
        return
    s.skipped = 0
    if s.points == WINDOW:
        halve(s, w, t)
    k = s.points
    w[k, 0], w[k, 1], w[k, 2], w[k, 3] = t, sp, pv, op
    s.points += 1


@jit
def halve(s, w, t_next):
    """Drop every second point; OP becomes the mean over both, so that its integral stays exact."""
    for k in range(WINDOW // 2):
        a, b = 2 * k, 2 * k + 1
        end = w[b + 1, 0] if b + 1 < WINDOW else t_next
        first, second = w[b, 0] - w[a, 0], end - w[b, 0]
        mean = (w[a, 3] * first + w[b, 3] * second) / (first + second)
        w[k, 0], w[k, 1], w[k, 2], w[k, 3] = w[a, 0], w[a, 1], w[a, 2], mean
    s.points = WINDOW // 2
    s.before = (s.before + 1) // 2
    s.stride *= 2


@jit
def close(s, h, out, n, i):
    """Hand the event out with the loop's health of this moment; its slot is freed by whoever copies the window."""
    o = out[n]
    o.kind = s.kind
    o.what, o.row, o.state, o.cause, o.slot = CLOSED, i, s.end_state, s.end_cause, s.slot
    o.points, o.before, o.onset, o.end, o.number = s.points, s.before, s.onset, s.end, s.events
    o.amplitude, o.quiet, o.period = s.amplitude, s.quiet, s.period
    o.duration = (s.end - s.onset) * 1e-9
    o.uncertain_share = (s.uncertain - s.uncertain_before) / max(s.ok - s.ok_before, 1)
    o.offset = s.sum_e / s.sum_t if s.sum_t > 0 else s.short
    o.s1, o.s2, o.s3, o.y1, o.y2 = s.s1, s.s2, s.s3, s.y1, s.y2
    o.iae, o.iae_noise, o.good_time, o.saturated_time = s.iae, s.iae_noise, s.good_time, s.saturated_time
    o.pv0, o.op0, o.error_sd, o.noise, o.quantum = s.pv0, s.op0, s.error_sd, s.noise, s.quantum
    o.short_sd = np.sqrt(s.var_s)
    o.health = h
    s.slot = -1
    return n + 1
