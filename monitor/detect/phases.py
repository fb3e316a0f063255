"""A loop from one phase to the next: warming, quiet, a candidate, an event, a moving set point (compiled)."""

from __future__ import annotations

import numpy as np

from monitor.compiled import jit, jit_inlined
from monitor.health.observe import observe

from . import act
from .accept import count_gaps, other_units
from .baseline import (
    await_baseline,
    follow_differences,
    load_step_suspected,
    relearn_noise,
    restart_loop,
    short_weight,
    update_baseline,
)
from .constants import (
    BESIDE_SHARE,
    CALM_SAMPLES,
    KNOWN_SAMPLES,
    MAX_GAP_PERIODS,
    MOST_HALF_WAVES,
    NOISE_FREE_SD,
    OUTSIDE_SAMPLES,
    SP_MISSING_SAMPLES,
    SPIKE_SD,
    STEP_STANDS_OUT_SD,
    STILL_LOAD_SHARE,
    STILL_SETPOINT_SHARE,
    STILLER_SD,
    SUSPECTED_LOAD_QUANTA,
    SUSPECTED_LOAD_SD,
    TIMEOUT_PERIODS,
    WARM_UP_SAMPLES,
)
from .event import BY_GAP, BY_MODE, BY_STEP, LOAD_STEP, SETPOINT_STEP
from .setpoint import come_to_rest, follow_jitter, follow_moving, moves_now, stands_out, start_moving
from .state import CANDIDATE, EVENT, MOVING, QUIET
from .window import add, end_event, restart_settling


@jit_inlined
def advance(s, h, p, time, sp, pv, op, auto):
    """Take in one good sample; return what to do with the loop's window, as a sum of `act`'s."""
    last, clock = s.last, s.clock
    if s.counts.ok == 1:
        s.setpoint.moved_at = time
        restart_loop(s, time, sp, pv)
        return 0
    back = time < last.time
    dt = 0.0 if back else (time - last.time) * 1e-9
    unseen = clock.sp_missing_run > SP_MISSING_SAMPLES and sp != last.sp
    gap = back or (clock.period > 0 and dt > MAX_GAP_PERIODS * clock.period) or unseen
    stepping = s.phase == EVENT and s.event.kind == SETPOINT_STEP
    observe(h, last, clock.period, p, dt, gap, sp, pv, op, auto, s.phase <= QUIET, stepping)
    if gap or clock.gap_run > 0:
        count_gaps(s, time, dt, gap, back)
    if gap or not auto or not last.auto or (sp != s.setpoint.level and other_units(s, sp, pv)):
        s.moves.in_manual += 1 if sp != last.sp and not gap else 0
        s.moves.cut_off += 1 if sp != last.sp and gap else 0
        return _break_off(s, BY_MODE if last.auto != auto and not gap else BY_GAP, time, sp, pv)
    follow_differences(s.noise, last, pv)
    follow_jitter(s, sp)
    if s.window.slot >= 0:
        _integrate(s, p, dt, pv)
    _update_short(s, dt, sp - pv)
    if s.phase > QUIET:
        return _follow(s, time, dt, sp, pv)
    if clock.period == 0:
        s.moves.cut_off += 1 if sp != last.sp else 0
        s.setpoint.level = sp
    elif moves_now(s, sp):
        start_moving(s, time, sp)
        return act.BEGIN
    if s.phase == QUIET and s.noise.snapshots > 0 and s.baseline.n >= CALM_SAMPLES and load_step_suspected(s):
        return act.BEGIN_LOAD
    update_baseline(s, sp - pv, pv, op)
    return 0


@jit
def _update_short(s, dt, e):
    """Carry the error's short average on; in a quiet loop a spike does not pull it far."""
    d = e - s.last.short_e
    var_e = s.noise.now.var_e
    if s.phase == QUIET and SPIKE_SD * SPIKE_SD * var_e < d * d < NOISE_FREE_SD * NOISE_FREE_SD * var_e:
        most = SPIKE_SD * (np.sqrt(var_e) + 0.5 * s.noise.quantum + 2e-3 * abs(s.event.amplitude))
        d = min(max(d, -most), most)
    s.last.short_e += short_weight(dt, s.clock.period) * d


@jit
def _break_off(s, cause, time, sp, pv):
    """Begin anew; return what becomes of an open window."""
    todo = end_early(s, cause, s.last.time, sp)
    restart_loop(s, time, sp, pv)
    return todo


@jit
def end_early(s, cause, time, sp):
    """End what is open for a cause from outside; return what becomes of its window.

    A set point's move that was not yet confirmed is, where it is more than noise.
    """
    if s.phase != EVENT and s.window.slot < 0:
        return 0
    todo = 0
    if s.phase != EVENT:
        if s.phase == CANDIDATE:
            s.event.amplitude = s.setpoint.level - s.setpoint.came_from
        if not stands_out(s, sp):
            s.moves.in_noise += 1
            return act.DROP
        todo = act.CONFIRM
    end_event(s, 2, cause, time)
    return todo | cut_or_drop(s)


@jit
def _follow(s, time, dt, sp, pv):
    """Move an eventful phase on by one sample; return what to do."""
    if s.phase == MOVING:
        return follow_moving(s, time, sp)
    if s.phase == EVENT:
        event = s.event
        load = event.kind == LOAD_STEP
        if load and sp == s.last.sp:  # a set point's step is in the error, too
            event.amplitude = max(event.amplitude, abs(s.last.short_e - s.noise.now.mean_s))
        if moves_now(s, sp):
            least = STEP_STANDS_OUT_SD * event.noise if load else BESIDE_SHARE * abs(event.amplitude)
            if abs(sp - s.setpoint.level) > least:
                end_event(s, 2, BY_STEP, time)
                todo = cut_or_drop(s) | act.BEGIN
                start_moving(s, time, sp)
                return todo
            # the level stays: a ramp's first steps are small, until together they are more
            if s.last.sp == s.setpoint.level:
                s.moves.beside += 1
                s.setpoint.beside = 1
        if not has_settled(s, time, dt, sp - pv):
            return 0
        s.setpoint.moves = 0
        if cut_or_drop(s) == act.CUT:
            return act.COMPLETE
        await_baseline(s)
        return act.DROP
    return come_to_rest(s, time, sp)


@jit
def cut_or_drop(s):
    """Say what becomes of an event that is over: a load step no larger than what weather brings is forgotten."""
    least = max(SUSPECTED_LOAD_SD * np.sqrt(s.noise.now.var_s), SUSPECTED_LOAD_QUANTA * s.noise.quantum)
    return act.DROP if s.event.kind == LOAD_STEP and s.event.amplitude < least else act.CUT


@jit
def _integrate(s, p, dt, pv):
    """Account for one sample of an open event."""
    last, period, integrals = s.last, s.clock.period, s.integrals
    add(s, last.sp, last.pv, pv, last.op, dt)
    integrals.good_time += dt if period == 0 else min(dt, 1.5 * period)
    if last.op <= p.op_low or last.op >= p.op_high:
        integrals.saturated_time += dt


@jit
def has_settled(s, time, dt, e):
    """Whether the event is over: the error's short average has lain still for half as long as it moved, or time is up.

    Away from zero (no integral action, saturation, or just a flat top) it has to lie four times as long, and
    twenty times where PV is still about where it was before the step, or where a load has sent it.
    """
    settling, noise, period, short = s.settling, s.noise, s.clock.period, s.last.short_e
    size = abs(s.event.amplitude)
    # the band of the short average when quiet; where that is not well known, 2 % of the step or white noise's
    band = min(6.0 * np.sqrt(noise.now.var_s), max(0.02 * size, 2.0 * s.event.noise))
    # a transmitter toggles between its last bits
    still = STILL_LOAD_SHARE if s.event.kind == LOAD_STEP else STILL_SETPOINT_SHARE
    band = max(band, 0.5 * min(noise.quantum, size), min(1.5 * noise.quantum, 0.1 * size), still * size)
    settling.low, settling.high = min(settling.low, short), max(settling.high, short)
    settling.sum_e += e * dt
    settling.sum_t += dt
    if settling.high - settling.low > 2.0 * band:
        _turn(settling, 1 if short == settling.high else -1)
        restart_settling(s, time)
    rest = (time - settling.since) * 1e-9
    busy = (settling.since - s.event.onset) * 1e-9
    offset = abs(settling.sum_e)
    patience = 1.0 if offset <= 0.5 * band * settling.sum_t else 4.0
    if offset > (0.5 if s.event.kind == LOAD_STEP else 0.8) * size * settling.sum_t:
        patience = 20.0  # PV has hardly begun, or has not begun to return: dead time, or a long lag
    if rest >= patience * max(WARM_UP_SAMPLES * period, 0.5 * busy):
        end_event(s, 1, 0, time)
        stiller = settling.high - settling.low < STILLER_SD * np.sqrt(noise.now.var_s)
        if stiller and rest > KNOWN_SAMPLES * period:
            relearn_noise(s, WARM_UP_SAMPLES)
        return True
    if rest + busy > TIMEOUT_PERIODS * period or settling.half_waves > MOST_HALF_WAVES:
        end_event(s, 3, 0, time)
        relearn_noise(s, OUTSIDE_SAMPLES)
        return True
    return False


@jit
def _turn(settling, side):
    """Count half waves: the error has left the band in which it lay, upwards or downwards."""
    if side != settling.side:
        settling.half_waves += 1
        settling.side = side
