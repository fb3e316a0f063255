"""A loop from one phase to the next: warming, quiet, a candidate, an event, a moving set point (compiled)."""

from __future__ import annotations

import numpy as np

from monitor.compiled import jit
from monitor.health.observe import observe

from .accept import count_gaps, other_units
from .baseline import (
    await_baseline,
    load_step_suspected,
    relearn_noise,
    restart_loop,
    short_weight,
    update_baseline,
)
from .event import BY_GAP, BY_MODE, BY_STEP, LOAD_STEP, SETPOINT_STEP
from .setpoint import come_to_rest, has_moved, is_at_rest, note_move, start_moving
from .state import (
    AWAY,
    BEGIN,
    BEGIN_LOAD,
    BLIND,
    CALM,
    CANDIDATE,
    CONFIRM,
    CUT,
    DONE,
    DROP,
    EVENT,
    HALF_WAVES,
    KNOWN,
    LOAD_QUANTA,
    LOAD_STANDS_OUT,
    MAX_GAP,
    MOVING,
    NOISE_FREE,
    OUTLIER,
    QUIET,
    RAMP_REST,
    STILLER,
    TIMEOUT,
    WARM_UP,
)
from .window import add, begin, close, confirm, drop, restart_settling


@jit
def advance(s, h, p, time, sp, pv, op, auto):
    """Take in one good sample; return what to do with the loop's window, as a sum of actions."""
    if s.seen == 0:
        s.moved = time
        restart_loop(s, sp, pv)
        return 0
    back = time < s.time
    dt = 0.0 if back else (time - s.time) * 1e-9
    gap = back or (s.period > 0 and dt > MAX_GAP * s.period) or (s.blind > BLIND and sp != s.sp)
    stepping = s.phase == EVENT and s.kind == SETPOINT_STEP
    observe(h, s, s.period, p, dt, gap, sp, pv, op, auto, s.phase <= QUIET, stepping)
    if gap or s.gaps > 0:
        count_gaps(s, time, dt, gap, back)
    if gap or not auto or not s.auto or (sp != s.held and other_units(s, sp, pv)):
        return _break_off(s, BY_MODE if s.auto != auto and not gap else BY_GAP, sp, pv)
    if s.slot >= 0:
        _integrate(s, p, dt, pv)
    d = sp - pv - s.short
    if s.phase == QUIET and OUTLIER * OUTLIER * s.var_e < d * d < NOISE_FREE * NOISE_FREE * s.var_e:
        most = OUTLIER * (np.sqrt(s.var_e) + 0.5 * s.quantum + 2e-3 * abs(s.amplitude))
        d = min(max(d, -most), most)
    s.short += short_weight(dt, s.period) * d
    if s.phase > QUIET:
        return _follow(s, time, dt, sp, pv)
    if s.warm < WARM_UP // 2:
        s.held = sp  # without a baseline no move is looked at, and the set point's jitter is not known
    elif has_moved(s, sp) and s.period > 0:
        start_moving(s, time, sp)
        return BEGIN
    if s.phase == QUIET and s.looks > 0 and s.based >= CALM and load_step_suspected(s):
        return BEGIN_LOAD
    update_baseline(s, sp - pv, pv, op)
    return 0


@jit
def _break_off(s, cause, sp, pv):
    """Begin anew; return what becomes of an open window."""
    act = 0
    if s.phase == CANDIDATE:
        act = DROP  # a set-point move that was cut off before it was confirmed
    elif s.phase == EVENT:
        end_event(s, 2, cause, s.time)
        act = cut_or_drop(s)
    restart_loop(s, sp, pv)
    return act


@jit
def _follow(s, time, dt, sp, pv):
    """Move an eventful phase on by one sample; return what to do."""
    if s.phase == MOVING:
        if has_moved(s, sp):
            note_move(s, time, sp)
        elif is_at_rest(s, time, RAMP_REST):
            await_baseline(s)
        return 0
    if s.phase == EVENT:
        if s.kind == LOAD_STEP:
            s.amplitude = max(s.amplitude, abs(s.short - s.mean_s))
        if has_moved(s, sp) and abs(sp - s.held) > 0.02 * abs(s.amplitude):
            end_event(s, 2, BY_STEP, time)
            act = cut_or_drop(s) | BEGIN
            start_moving(s, time, sp)
            return act
        if not has_settled(s, time, dt, sp - pv):
            return 0
        s.moves = 0
        if cut_or_drop(s) == CUT:
            return DONE
        await_baseline(s)
        return DROP
    return come_to_rest(s, time, sp)


@jit
def apply_actions(act, s, h, ring, ring_time, slab, free, n_free, out, n, i, time, sp):
    """Do with the window what `_step` asked for; return the number of events in ``out``."""
    if act & DROP:
        drop(s, free, n_free)
    if act & CONFIRM:
        n = confirm(s, out, n, i, time, sp)
    if act & (CUT | DONE):
        await_baseline(s)
        n = close(s, h, out, n, i)
    if act & (BEGIN | BEGIN_LOAD):
        begin(s, ring, ring_time, slab, free, n_free, i, time)
    return n


@jit
def end_event(s, state, cause, time):
    """Note how, why and when an event ends."""
    s.end_state, s.end_cause, s.end = state, cause, time


@jit
def cut_or_drop(s):
    """Say what becomes of an event that is over: a load step no larger than what weather brings is forgotten."""
    nothing = s.amplitude < max(LOAD_STANDS_OUT * np.sqrt(s.var_s), LOAD_QUANTA * s.quantum)
    return DROP if s.kind == LOAD_STEP and nothing else CUT


@jit
def _integrate(s, p, dt, pv):
    """Account for one sample of an open event."""
    add(s, s.sp, s.pv, pv, s.op, dt)
    s.good_time += dt if s.period == 0 else min(dt, 1.5 * s.period)
    if s.op <= p.op_low or s.op >= p.op_high:
        s.saturated_time += dt


@jit
def has_settled(s, time, dt, e):
    """Whether the event is over: the error's short average has lain still for half as long as it moved, or time is up.

    Away from zero (no integral action, saturation, or just a flat top) it has to lie four times as long, and
    twenty times where PV is still about where it was before the step, or where a load has sent it.
    """
    size = abs(s.amplitude)
    # the band of the short average when quiet; where that is not well known, 2 % of the step or white noise's
    band = min(6.0 * np.sqrt(s.var_s), max(0.02 * size, 2.0 * s.noise))
    # a transmitter toggles between its last bits
    band = max(band, 0.5 * min(s.quantum, size), min(1.5 * s.quantum, 0.1 * size), 1e-4 * size)
    s.low, s.high = min(s.low, s.short), max(s.high, s.short)
    s.sum_e += e * dt
    s.sum_t += dt
    if s.high - s.low > 2.0 * band:
        _turn(s, 1 if s.short == s.high else -1)
        restart_settling(s, time)
    rest = (time - s.still) * 1e-9
    busy = (s.still - s.onset) * 1e-9
    offset = abs(s.sum_e)
    patience = 1.0 if offset <= 0.5 * band * s.sum_t else 4.0
    if offset > (0.5 if s.kind == LOAD_STEP else 0.8) * size * s.sum_t:
        patience = 20.0  # PV has hardly begun, or has not begun to return: dead time, or a long lag
    if rest >= patience * max(WARM_UP * s.period, 0.5 * busy):
        end_event(s, 1, 0, time)
        if s.high - s.low < STILLER * np.sqrt(s.var_s) and rest > KNOWN * s.period:
            relearn_noise(s, WARM_UP)
        return True
    if rest + busy > TIMEOUT * s.period or s.waves > HALF_WAVES:
        end_event(s, 3, 0, time)
        relearn_noise(s, AWAY)
        return True
    return False


@jit
def _turn(s, side):
    """Count half waves: the error has left the band in which it lay, upwards or downwards."""
    if side != s.side:
        s.waves += 1
        s.side = side
