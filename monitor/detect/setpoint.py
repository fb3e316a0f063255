"""Whether a set point moves, and whether its move is a step, a ramp or nothing (compiled)."""

from __future__ import annotations

import numpy as np

from monitor.compiled import jit

from . import act
from .constants import (
    MOST_PACE_PERIODS,
    REST_PACES,
    RESTLESS_PERIODS,
    ROUNDING_SHARE,
    SAME_LEVEL_SD,
    STEP_LASTS_PERIODS,
    STEP_MOVES_SAMPLES,
    STEP_REST_PERIODS,
    STEP_STANDS_OUT_SD,
)
from .state import MOVING, QUIET


@jit
def has_moved(s, sp):
    """Whether a set point is no longer where it last rested or moved to."""
    level = s.setpoint.level
    return sp != level and abs(sp - level) > SAME_LEVEL_SD * np.sqrt(
        s.noise.now.var_e
    ) + ROUNDING_SHARE * abs(sp)


@jit
def start_moving(s, time, sp):
    """Note that a set point leaves its rest."""
    s.setpoint.came_from = s.setpoint.level
    s.setpoint.moves = 0
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
        setpoint.moves += 1
        setpoint.level = sp
        lasted = (time - event.onset) * 1e-9 / s.clock.period
        if setpoint.moves > STEP_MOVES_SAMPLES or lasted > STEP_LASTS_PERIODS:
            setpoint.pace = min(setpoint.pace, lasted / (setpoint.moves - 1))
            s.phase = MOVING
        setpoint.moved_at = time
        return act.DROP if s.phase == MOVING else 0
    if not is_at_rest(s, time, STEP_REST_PERIODS):
        return 0
    event.amplitude = sp - setpoint.came_from
    least = STEP_STANDS_OUT_SD * max(event.error_sd, 0.99 * s.noise.quantum)
    if abs(event.amplitude) > max(least, ROUNDING_SHARE * abs(sp)):
        return act.CONFIRM
    s.phase = QUIET  # the set point moved, but within the noise
    return act.DROP
