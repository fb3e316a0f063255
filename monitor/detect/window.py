"""The compiled life of an event's window: opened, its integrals carried, thinned when full, handed out.

``s`` is one loop's state. Types are inferred by numba.
"""

from __future__ import annotations

import numpy as np

from monitor.compiled import jit

from .baseline import quiet_sd, white_sd
from .constants import (
    COARSE_SAMPLES,
    LEAST_BEFORE_SAMPLES,
    RING_SAMPLES,
    UNRESTED_BEFORE_SAMPLES,
    UNRESTED_SD,
    WARM_UP_SAMPLES,
    WINDOW_POINTS,
)
from .event import LOAD_STEP, MEAN_ABS_SD, SETPOINT_STEP
from .state import CANDIDATE, CLOSED, EVENT, OPENED


@jit
def begin(s, stores, i, time):
    """Open a window for a set point that has begun to move; the integrals start here."""
    event, window, integrals, last = s.event, s.window, s.integrals, s.last
    s.phase = CANDIDATE
    event.kind = SETPOINT_STEP
    event.onset = time
    event.began = s.baseline.began
    event.ok_before, event.uncertain_before = s.counts.ok, s.counts.uncertain
    stores.n_free[0] -= 1
    window.slot = stores.free[stores.n_free[0]]
    integrals.s1 = integrals.s2 = integrals.y1 = integrals.iae = integrals.iae_noise = 0.0
    integrals.good_time = integrals.saturated_time = 0.0
    based = s.baseline.n >= WARM_UP_SAMPLES // 2
    event.pv0 = s.baseline.pv if based else last.pv
    event.op0 = s.baseline.op if based else last.op
    event.error_sd, event.noise = quiet_sd(s.noise), white_sd(s.noise)
    inside = s.noise.outside_run == 0
    event.quiet = 1.0 if s.baseline.n >= WARM_UP_SAMPLES and inside else 0.0
    if event.quiet == 0.0:
        event.error_sd = min(event.error_sd, UNRESTED_SD * event.noise)
    # what lies before the loop came to rest belongs to another event; without rest some of it shows how PV moved
    known = s.baseline.n if event.quiet > 0.0 else UNRESTED_BEFORE_SAMPLES
    m = min(s.ring_n, RING_SAMPLES, max(known, LEAST_BEFORE_SAMPLES))
    w, rings = stores.slab[window.slot], stores.rings[i]
    for j in range(m):
        k = (s.ring_n - m + j) % RING_SAMPLES
        w[j, 0] = (rings.time[k] - time) * 1e-9
        w[j, 1], w[j, 2], w[j, 3] = rings.values[k, 0], rings.values[k, 1], rings.values[k, 2]
    window.n = window.before = m
    window.stride = 1
    window.skipped = 0


@jit
def begin_load(s, stores, i, time, pv):
    """Turn the window just opened into a suspected load step's; it and the integrals reach back to quiet times.

    The step came before it was noticed: the onset is found when the event is assessed. Nothing is reported
    until then.
    """
    event, noise, last = s.event, s.noise, s.last
    s.phase = EVENT
    event.kind = LOAD_STEP
    event.number += 1
    noise.now = noise.older  # that of before the response
    event.error_sd = np.sqrt(noise.now.var_e)
    event.amplitude = abs(last.short_e - noise.now.mean_s)
    restart_settling(s, time)
    s.settling.half_waves = s.settling.side = 0
    w = stores.slab[s.window.slot]
    n = _reach_back(s, stores.rings[i], w, time)
    s.window.n = s.window.before = n
    event.pv0 = event.op0 = 0.0
    for k in range(n // 2):
        event.pv0 += w[k, 2] / (n // 2)
        event.op0 += w[k, 3] / (n // 2)
    for k in range(n - 1):
        add(s, w[k, 1], w[k, 2], w[k + 1, 2], w[k, 3], w[k + 1, 0] - w[k, 0])
    add(s, last.sp, last.pv, pv, last.op, (time - last.time) * 1e-9)


@jit
def _reach_back(s, rings, w, time):
    """Fill the window with what is known of the loop since it came to rest, coarse and fine; return the points."""
    values, coarse = rings.values, rings.coarse
    reach = s.baseline.n + s.noise.outside_run
    start = s.ring_n - min(s.ring_n, RING_SAMPLES, reach)
    first = ((start + COARSE_SAMPLES - 1) // COARSE_SAMPLES) * COARSE_SAMPLES  # of the fine points
    n = 0
    quiet = (s.ring_n - reach + COARSE_SAMPLES - 1) // COARSE_SAMPLES
    quiet = max(quiet, s.ring_n // COARSE_SAMPLES - RING_SAMPLES + 1, 0)
    for k in range(quiet, first // COARSE_SAMPLES):
        j = k & (RING_SAMPLES - 1)
        w[n, 0] = (rings.coarse_time[j] - time) * 1e-9
        w[n, 1], w[n, 2], w[n, 3] = coarse[j, 0], coarse[j, 1], coarse[j, 2]
        n += 1
    for k in range(first, s.ring_n):
        j = k & (RING_SAMPLES - 1)
        w[n, 0] = (rings.time[j] - time) * 1e-9
        w[n, 1], w[n, 2], w[n, 3] = values[j, 0], values[j, 1], values[j, 2]
        n += 1
    return n


@jit
def restart_settling(s, time):
    """Begin anew to watch whether the error lies still."""
    settling = s.settling
    settling.since = time
    settling.low = settling.high = s.last.short_e
    settling.sum_e = settling.sum_t = 0.0


@jit
def end_event(s, state, cause, time):
    """Note how, why and when an event ends."""
    s.event.state, s.event.cause, s.event.end = state, cause, time


@jit
def confirm(s, out, n, i, time, sp):
    """Report that an event has opened: the set point rests at a new level."""
    s.phase = EVENT
    s.event.number += 1
    s.moves.recorded += 1
    s.setpoint.level = sp
    restart_settling(s, time)
    s.settling.half_waves = s.settling.side = 0
    o = out[n]
    o.what, o.row, o.slot = OPENED, i, -1
    o.onset, o.number, o.amplitude = s.event.onset, s.event.number, s.event.amplitude
    return n + 1


@jit
def drop(s, stores):
    """Forget a window: its slot is free again."""
    stores.free[stores.n_free[0]] = s.window.slot
    stores.n_free[0] += 1
    s.window.slot = -1


@jit
def add(s, sp, pv_old, pv_new, op, dt):
    """Carry the running integrals over one sample (set-point and load forms share them).

    OP is held: left rectangles; PV and the integrals of integrals: trapezoids. SP is held as well, so the
    error's trapezoid ends with the old set point.
    """
    event, integrals, now = s.event, s.integrals, s.noise.now
    s1 = integrals.s1 + (op - event.op0) * dt
    integrals.s2 += 0.5 * (integrals.s1 + s1) * dt
    integrals.s1 = s1
    integrals.y1 += 0.5 * ((pv_old - event.pv0) + (pv_new - event.pv0)) * dt
    area = 0.5 * (abs(sp - pv_old) + abs(sp - pv_new)) * dt
    integrals.iae += area
    if abs(s.last.short_e - now.mean_e) < 2.0 * event.error_sd:  # nothing but noise is left here
        # what an upset before has taught is no noise: that is what PV's differences show, and its rounding
        white = max(MEAN_ABS_SD * event.noise, 0.5 * s.noise.quantum)
        integrals.iae_noise += min(area, min(now.abs_e, white) * dt)


@jit
def append(s, slab, time, sp, pv, op):
    """Put the sample into the window; OP of a skipped sample goes, by time, into the last point's mean."""
    window, onset = s.window, s.event.onset
    w = slab[window.slot]
    t = (time - onset) * 1e-9
    last = window.n - 1
    if window.skipped > 0:
        # w[last, 3] holds the mean OP from the last point to the last sample, whose OP was held since
        before = (s.last.time - onset) * 1e-9 - w[last, 0]
        whole = t - w[last, 0]
        w[last, 3] = (w[last, 3] * before + s.last.op * (whole - before)) / whole
    window.skipped += 1
    if window.skipped < window.stride:
        return
    window.skipped = 0
    if window.n == WINDOW_POINTS:
        halve(window, w, t)
    k = window.n
    w[k, 0], w[k, 1], w[k, 2], w[k, 3] = t, sp, pv, op
    window.n += 1


@jit
def halve(window, w, t_next):
    """Drop every second point; OP becomes the mean over both, so that its integral stays exact."""
    for k in range(WINDOW_POINTS // 2):
        a, b = 2 * k, 2 * k + 1
        end = w[b + 1, 0] if b + 1 < WINDOW_POINTS else t_next
        first, second = w[b, 0] - w[a, 0], end - w[b, 0]
        mean = (w[a, 3] * first + w[b, 3] * second) / (first + second)
        w[k, 0], w[k, 1], w[k, 2], w[k, 3] = w[a, 0], w[a, 1], w[a, 2], mean
    window.n = WINDOW_POINTS // 2
    window.before = (window.before + 1) // 2
    window.stride *= 2


@jit
def close(s, h, out, n, i):
    """Hand the event out with the loop's health of this moment; its slot is freed by whoever copies the window."""
    event, window, settling, integrals = s.event, s.window, s.settling, s.integrals
    o = out[n]
    o.what, o.row, o.slot, o.points, o.before = CLOSED, i, window.slot, window.n, window.before
    o.kind, o.state, o.cause, o.number = event.kind, event.state, event.cause, event.number
    o.onset, o.end, o.duration = event.onset, event.end, (event.end - event.onset) * 1e-9
    o.amplitude, o.quiet, o.period = event.amplitude, event.quiet, s.clock.period
    o.since_start = (event.onset - event.began) * 1e-9
    o.uncertain_share = (s.counts.uncertain - event.uncertain_before) / max(s.counts.ok - event.ok_before, 1)
    o.offset = settling.sum_e / settling.sum_t if settling.sum_t > 0 else s.last.short_e
    o.s1, o.s2, o.y1 = integrals.s1, integrals.s2, integrals.y1
    o.iae, o.iae_noise = integrals.iae, integrals.iae_noise
    o.good_time, o.saturated_time = integrals.good_time, integrals.saturated_time
    o.pv0, o.op0, o.error_sd, o.noise = event.pv0, event.op0, event.error_sd, event.noise
    o.short_sd, o.quantum = np.sqrt(s.noise.now.var_s), s.noise.quantum
    o.health = h
    window.slot = -1
    return n + 1
