"""What a quiet loop is like: level and noise, and whether a load step may have begun (compiled)."""

from __future__ import annotations

import numpy as np

from monitor.compiled import jit

from .state import (
    AWAY,
    BASE,
    GLITCH,
    KNOWN,
    LONG,
    QUIET,
    RAMP_CALM,
    RING,
    SHORT,
    SNAPSHOT,
    TRIGGER,
    UNREST,
    WARM_UP,
    WARMING,
)


@jit
def restart_loop(s, sp, pv):
    """Begin anew after a gap, a mode change, or at the loop's first sample."""
    s.phase = WARMING
    s.warm = s.based = s.away = s.ringed = s.looks = 0
    s.mean_e = s.var_e = s.abs_e = s.var_s = s.var_d = 0.0
    s.unrest = 0.0
    s.learn = WARM_UP
    s.short = s.mean_s = sp - pv
    s.quantum = 0.0
    s.held = sp


@jit
def short_weight(dt, period):
    """Weight of the short average over ``dt``: two missed samples weigh as two."""
    if period <= 0 or abs(dt - period) < 1e-3 * period:
        return SHORT  # the power costs as much as all the rest
    return 1.0 - (1.0 - SHORT) ** (dt / period)


@jit
def update_baseline(s, e, pv, op):  # noqa: C901 (a line for each average)
    """Update the baseline of a quiet loop.

    Values outside three sigma do not count (they are the disturbance, not the noise). A loop that stays
    outside is one whose level or noise has changed: after a while its baseline begins anew.
    """
    known = s.warm > s.learn
    off = abs(s.short - s.mean_s) - 0.5 * s.quantum
    if known and off > 0.0 and off * off > 25.0 * s.var_s:
        s.away += 1
        s.unrest += 1.0
        # until then it may be a load step in its beginnings: the baseline is still wanted
        if s.away > RING or (s.moves > 0 and s.based < RAMP_CALM):
            s.based = 0
        if s.unrest > AWAY:
            relearn_noise(s, AWAY)
        return
    s.away = 0
    if s.unrest > 0.0:
        s.unrest -= UNREST
    s.warm += 1
    if s.warm == 1:
        s.mean_e = s.mean_s = s.short = e
        s.abs_e = s.var_e = s.var_s = s.var_d = 0.0
    w = 1.0 / s.warm if s.warm * LONG < 1.0 else LONG
    # while little is known, one glitch must not pass for the noise
    most = GLITCH * s.abs_e if not known and s.warm > 3 and s.abs_e > 0.0 else np.inf
    d = min(max(e - s.mean_e, -most), most)
    if not known or d * d <= 9.0 * s.var_e or s.var_e == 0.0:
        s.mean_e += w * d
        s.var_e += w * (d * d - s.var_e)
        s.abs_e += w * (abs(d) - s.abs_e)
    d = s.short - s.mean_s
    if known and d * d > 9.0 * s.var_s > 0.0:
        d = np.sign(d) * 3.0 * np.sqrt(s.var_s)
    d = min(max(d, -most), most)
    s.mean_s += w * d
    s.var_s += w * (d * d - s.var_s)
    # second differences see noise and hardly any process: var = 6 sigma^2 for white noise
    d = min(max(pv - s.pv - s.dpv, -2.0 * most), 2.0 * most)
    if s.warm > 2 and (not known or d * d <= 16.0 * s.var_d or s.var_d == 0.0):
        s.var_d += w * (d * d - s.var_d)
    s.based += 1
    w = 1.0 / s.based if s.based * BASE < 1.0 else BASE
    if s.based == 1:
        s.mean_pv, s.mean_op = pv, op
    s.mean_pv += w * (pv - s.mean_pv)
    s.mean_op += w * (op - s.mean_op)
    if s.phase == WARMING and s.based >= WARM_UP:
        s.phase = QUIET
    if s.warm >= max(KNOWN, s.learn) and (s.warm - KNOWN) % SNAPSHOT == 0:
        snapshot_noise(s)


@jit
def relearn_noise(s, learn):
    """Forget the noise: the loop has another one now, to be known after ``learn`` samples (many, to see slow waves)."""
    s.warm = s.looks = 0
    s.learn = learn
    s.unrest = 0.0


@jit
def snapshot_noise(s):
    """Keep the error's noise as it is now; the look before stays at hand."""
    first = s.looks == 0
    s.mean_e_2, s.var_e_2 = (s.mean_e, s.var_e) if first else (s.mean_e_1, s.var_e_1)
    s.mean_s_2, s.var_s_2 = (s.mean_s, s.var_s) if first else (s.mean_s_1, s.var_s_1)
    s.abs_e_2 = s.abs_e if first else s.abs_e_1
    s.mean_e_1, s.var_e_1, s.abs_e_1, s.mean_s_1, s.var_s_1 = s.mean_e, s.var_e, s.abs_e, s.mean_s, s.var_s
    s.looks += 1


@jit
def load_step_suspected(s):
    """Whether the short average of the error has left its band: a load step, or the plant's weather."""
    if (s.short - s.mean_s_2) ** 2 <= TRIGGER * TRIGGER * s.var_s_2:
        return False  # nearly always
    wider = 1.0 + 30.0 / (KNOWN + SNAPSHOT * max(s.looks - 2, 0))
    # without noise the band would be nothing: the last event's tail, below its own settling band, is no load
    least = 0.5 * s.quantum + 2e-3 * abs(s.amplitude) + 1e-9 * abs(s.sp)
    band = TRIGGER * wider * np.sqrt(s.var_s_2) + least
    return abs(s.short - s.mean_s_2) > band and (s.moves == 0 or s.based >= RAMP_CALM)


@jit
def await_baseline(s):
    """Wait for a new baseline; what is known of the noise stays."""
    s.phase = WARMING
    s.based = 0
