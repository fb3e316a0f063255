"""Whether a set point moves, and whether its move is a step, a ramp or nothing (compiled)."""

from __future__ import annotations

from monitor.compiled import jit

from . import act
from .baseline import await_baseline, quiet_sd, white_sd
from .constants import (
    BUSY_SHARE,
    JITTER_SIZES,
    JITTER_WEIGHT,
    JITTERY_SHARE,
    LEAST_TURNS,
    MOST_MOVING_SAMPLES,
    MOST_PACE_PERIODS,
    MOVING_SAMPLES,
    NET_SHARE,
    RAMP_REST_PERIODS,
    REST_PACES,
    RESTLESS_PERIODS,
    ROUNDING_SHARE,
    SAME_LEVEL_SD,
    STEP_LASTS_PERIODS,
    STEP_MOVES_SAMPLES,
    STEP_REST_PERIODS,
    STEP_STANDS_OUT_SD,
)
from .event import BY_MOVING, SETPOINT_RAMP
from .state import MOVING, QUIET
from .window import end_event


@jit
def follow_jitter(s, sp):
    """Take a sample into what is known of the set point's changes: an operator's is still, an analog one jitters."""
    setpoint = s.setpoint
    change = abs(sp - s.last.sp)
    if change == 0.0 and setpoint.busy == 0.0:
        return  # nearly always
    w = max(JITTER_WEIGHT, 1.0 / (s.ring_n + 1.0))
    if change == 0.0:
        setpoint.busy -= w * setpoint.busy
        if setpoint.busy < 1e-3:
            setpoint.busy = setpoint.jitter = 0.0
        return
    setpoint.busy += w * (1.0 - setpoint.busy)
    if setpoint.jitter > 0.0:  # a step is no jitter
        change = min(change, JITTER_SIZES * setpoint.jitter)
    setpoint.jitter += max(w, 0.1) * (change - setpoint.jitter) if setpoint.jitter > 0.0 else change


@jit
def has_moved(s, sp):
    """Whether a set point is no longer where it last rested or moved to."""
    setpoint = s.setpoint
    away = abs(sp - setpoint.level)
    if away == 0.0:
        return False
    least = SAME_LEVEL_SD * (quiet_sd(s.noise) if setpoint.busy > BUSY_SHARE else white_sd(s.noise))
    if setpoint.busy > JITTERY_SHARE:
        least = max(least, JITTER_SIZES * setpoint.jitter)
    return away > least + ROUNDING_SHARE * abs(sp)


@jit
def moves_now(s, sp):
    """Whether a resting set point has just moved; where it crept away unseen, that is its new rest."""
    if sp == s.setpoint.level or not has_moved(s, sp):
        return False
    if sp != s.last.sp:
        return True
    s.setpoint.level = sp
    s.moves.in_noise += 1 - s.setpoint.beside
    s.setpoint.beside = 0
    return False


@jit
def start_moving(s, time, sp):
    """Note that a set point leaves its rest."""
    s.setpoint.came_from = s.setpoint.level
    s.setpoint.moves = s.setpoint.turns = 0
    s.setpoint.way = 0.0
    s.setpoint.beside = 0
    note_move(s, time, sp)


@jit
def note_move(s, time, sp):
    """Note that a set point moves, and how often it does."""
    setpoint = s.setpoint
    rest = (time - setpoint.moved_at) * 1e-9 / s.clock.period
    if setpoint.pace > 0:
        setpoint.pace = 0.5 * (setpoint.pace + min(rest, MOST_PACE_PERIODS))
    else:  # only a part of the first rest was seen: a short one counts as a master's scan, to be outlasted by half
        short = 2.0 * rest < RESTLESS_PERIODS
        setpoint.pace = 1.5 * rest / REST_PACES if short else min(2.0 * rest, MOST_PACE_PERIODS)
    _go_to(s, time, sp)


@jit
def _go_to(s, time, sp):
    """Take over a set point's new level."""
    setpoint = s.setpoint
    way = sp - setpoint.level
    if way * setpoint.way < 0.0:
        setpoint.turns += 1
    setpoint.way = way
    setpoint.moved_at = time
    setpoint.moves += 1
    setpoint.level = sp


@jit
def is_at_rest(s, time, least):
    """Whether a moving set point has come to rest [least: periods]."""
    pace = s.setpoint.pace
    need = max(least, REST_PACES * pace) if pace < RESTLESS_PERIODS else least
    return (time - s.setpoint.moved_at) * 1e-9 > (need - 0.5) * s.clock.period


@jit
def come_to_rest(s, time, sp):
    """Follow a set point that has begun to move: a step, a ramp, or nothing; return what to do."""
    setpoint, event = s.setpoint, s.event
    if has_moved(s, sp):
        _go_to(s, time, sp)
        lasted = (time - event.onset) * 1e-9 / s.clock.period
        if setpoint.moves > STEP_MOVES_SAMPLES or lasted > STEP_LASTS_PERIODS:
            setpoint.pace = min(setpoint.pace, lasted / (setpoint.moves - 1))
            go_on_moving(s)
            if setpoint.busy > JITTERY_SHARE and s.counts.ok < setpoint.next_way:  # a slave, seen lately
                s.moves.unrecorded += 1
                return act.DROP
        return 0
    if not is_at_rest(s, time, STEP_REST_PERIODS):
        return 0
    event.amplitude = sp - setpoint.came_from
    if stands_out(s, sp):
        return act.CONFIRM
    s.moves.in_noise += 1
    s.phase = QUIET  # the set point moved, but within the noise
    return act.DROP


@jit
def stands_out(s, sp):
    """Whether a set point's move is more than noise; where somebody set it, what was an upset before is none."""
    noise = s.event.error_sd if s.setpoint.busy > BUSY_SHARE else s.event.noise
    least = STEP_STANDS_OUT_SD * max(noise, 0.99 * s.noise.quantum)
    return abs(s.event.amplitude) > max(least, ROUNDING_SHARE * abs(sp))


@jit
def go_on_moving(s):
    """Take the open window for that of a set point that goes on moving."""
    s.phase = MOVING
    s.event.kind = SETPOINT_RAMP
    s.event.amplitude = s.setpoint.level - s.setpoint.came_from


@jit
def follow_moving(s, time, sp):
    """Follow a set point that goes on moving until it rests; return what to do."""
    setpoint, event = s.setpoint, s.event
    open_window = s.window.slot >= 0
    if has_moved(s, sp):
        note_move(s, time, sp)
        away = sp - setpoint.came_from
        if open_window and abs(away) > abs(event.amplitude):
            event.amplitude = away
        if not open_window:
            return _window_again(s)
        samples = s.counts.ok - event.ok_before
        back_and_forth = setpoint.turns >= LEAST_TURNS
        if samples >= (MOVING_SAMPLES if back_and_forth else MOST_MOVING_SAMPLES):
            return _hand_on(s, time)
        return 0
    return _rest_at_last(s, sp) if is_at_rest(s, time, RAMP_REST_PERIODS) else 0


@jit
def _rest_at_last(s, sp):
    """Say what becomes of a moving set point that has come to rest."""
    todo = 0
    if s.window.slot >= 0:
        net = sp - s.setpoint.came_from
        if abs(net) > NET_SHARE * abs(s.event.amplitude):
            s.event.amplitude = net
        if stands_out(s, sp):
            return act.CONFIRM
        s.moves.in_noise += 1
        todo = act.DROP
    await_baseline(s)
    return todo


@jit
def _window_again(s):
    """Open a window of a set point that goes on moving once its last one is long past."""
    if s.counts.ok < s.setpoint.next_way:
        s.moves.unrecorded += 1
        return 0
    s.setpoint.turns = 0
    s.setpoint.came_from = s.last.sp
    return act.BEGIN | act.GO_ON


@jit
def _hand_on(s, time):
    """Hand out the window of a set point that goes on moving; return what to do."""
    s.setpoint.next_way = s.counts.ok + min(s.counts.ok, MOST_MOVING_SAMPLES * 8)
    end_event(s, 2, BY_MOVING, time)
    s.event.number += 1
    s.moves.recorded += 1
    return act.CUT | act.GO_ON
