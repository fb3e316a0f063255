"""Whether a set point moves, and whether its move is a step, a ramp or nothing (compiled)."""

from __future__ import annotations

import numpy as np

from monitor.compiled import jit

from .state import (
    CONFIRM,
    DROP,
    MOVING,
    PACE,
    PATIENCE,
    QUIET,
    RESTLESS,
    ROUNDING,
    SAME_LEVEL,
    STEP_LASTS,
    STEP_MOVES,
    STEP_REST,
    STEP_STANDS_OUT,
)


@jit
def has_moved(s, sp):
    """Whether a set point is no longer where it last rested or moved to."""
    return sp != s.held and abs(sp - s.held) > SAME_LEVEL * np.sqrt(s.var_e) + ROUNDING * abs(sp)


@jit
def start_moving(s, time, sp):
    """Note that a set point leaves its rest."""
    s.sp_from = s.held
    s.moves = 0
    note_move(s, time, sp)


@jit
def note_move(s, time, sp):
    """Note that a set point moves, and how often it does."""
    rest = (time - s.moved) * 1e-9 / s.period
    if s.pace > 0:
        s.pace = 0.5 * (s.pace + min(rest, PACE))
    else:  # only a part of the first rest was seen: a short one counts as a master's scan, to be outlasted by half
        s.pace = min(2.0 * rest, PACE) if 2.0 * rest >= RESTLESS else 1.5 * rest / PATIENCE
    s.moved = time
    s.moves += 1
    s.held = sp


@jit
def is_at_rest(s, time, least):
    """Whether a moving set point has come to rest [least: periods]."""
    need = max(least, PATIENCE * s.pace) if s.pace < RESTLESS else least
    return (time - s.moved) * 1e-9 > (need - 0.5) * s.period


@jit
def come_to_rest(s, time, sp):
    """Follow a set point that has begun to move: a step, a ramp, or nothing; return what to do."""
    if has_moved(s, sp):
        s.moves += 1
        s.held = sp
        lasted = (time - s.onset) * 1e-9 / s.period
        if s.moves > STEP_MOVES or lasted > STEP_LASTS:
            s.pace = min(s.pace, lasted / (s.moves - 1))
            s.phase = MOVING
        s.moved = time
        return DROP if s.phase == MOVING else 0
    if not is_at_rest(s, time, STEP_REST):
        return 0
    s.amplitude = sp - s.sp_from
    if abs(s.amplitude) > max(STEP_STANDS_OUT * max(s.error_sd, 0.99 * s.quantum), ROUNDING * abs(sp)):
        return CONFIRM
    s.phase = QUIET  # the set point moved, but within the noise
    return DROP
