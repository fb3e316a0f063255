"""What a quiet loop is like: level and noise, and whether a load step may have begun (compiled)."""

from __future__ import annotations

import numpy as np

from monitor.compiled import jit

from .constants import (
    BASELINE_WEIGHT,
    GLITCH_MEAN_SIZES,
    INSIDE_COUNTS_SAMPLES,
    KNOWN_SAMPLES,
    LONG_WEIGHT,
    NEAR_WEIGHT,
    OUTSIDE_SAMPLES,
    RAMP_CALM_SAMPLES,
    RING_SAMPLES,
    SHORT_WEIGHT,
    SNAPSHOT_SAMPLES,
    TAIL_SHARE,
    TOO_WIDE_LOOKS,
    TOO_WIDE_RATIO,
    TOO_WIDE_SAMPLES,
    TRIGGER_SD,
    WARM_UP_SAMPLES,
)
from .state import QUIET, WARMING


@jit
def restart_loop(s, time, sp, pv):
    """Begin anew after a gap, a mode change, or at the loop's first sample."""
    noise, now = s.noise, s.noise.now
    s.phase = WARMING
    s.ring_n = s.baseline.n = 0
    noise.n = noise.outside_run = noise.snapshots = 0
    now.mean_e = now.var_e = now.abs_e = now.var_s = noise.var_d = 0.0
    noise.n_d = noise.too_wide = 0
    noise.unrest = 0.0
    s.baseline.began = time
    noise.least_n = WARM_UP_SAMPLES
    s.last.short_e = now.mean_s = sp - pv
    noise.quantum = 0.0
    s.setpoint.level = sp


@jit
def short_weight(dt, period):
    """Weight of the short average over ``dt``: two missed samples weigh as two."""
    if period <= 0 or abs(dt - period) < 1e-3 * period:
        return SHORT_WEIGHT  # the power costs as much as all the rest
    return 1.0 - (1.0 - SHORT_WEIGHT) ** (dt / period)


@jit
def update_baseline(s, e, pv, op):
    """Update the baseline of a quiet loop.

    Values outside three sigma do not count (they are the disturbance, not the noise). A loop that stays
    outside is one whose level or noise has changed: after a while its baseline begins anew.
    """
    noise, now = s.noise, s.noise.now
    known = noise.n > noise.least_n
    # without noise the band would be nothing, and the tail of the last event for ever outside
    off = abs(s.last.short_e - now.mean_s) - 0.5 * noise.quantum
    if known and off > TAIL_SHARE * abs(s.event.amplitude) and off * off > 25.0 * now.var_s:
        _stay_outside(s)
        return
    noise.outside_run = 0
    if noise.unrest > 0.0:
        noise.unrest -= INSIDE_COUNTS_SAMPLES
    noise.n += 1
    if noise.n == 1:
        now.mean_e = now.mean_s = s.last.short_e = noise.near_e = e
        now.abs_e = now.var_e = now.var_s = noise.near_var = 0.0
    w = 1.0 / noise.n if noise.n * LONG_WEIGHT < 1.0 else LONG_WEIGHT
    # while little is known, one glitch must not pass for the noise
    most = GLITCH_MEAN_SIZES * now.abs_e if not known and noise.n > 3 and now.abs_e > 0.0 else np.inf
    _update_error(now, s.last.short_e, e, w, most, known)
    d = e - noise.near_e
    noise.near_e += NEAR_WEIGHT * d
    noise.near_var += max(w, NEAR_WEIGHT) * (d * d - noise.near_var)
    _update_level(s.baseline, pv, op)
    if s.phase == WARMING and s.baseline.n >= WARM_UP_SAMPLES:
        s.phase = QUIET
    if noise.n >= max(KNOWN_SAMPLES, noise.least_n) and (noise.n - KNOWN_SAMPLES) % SNAPSHOT_SAMPLES == 0:
        _look_at_noise(s)


@jit
def _look_at_noise(s):
    """Keep the noise as it is known; learn it anew, once, where the loop began in an upset that is over.

    Later ones teach nothing: what lies far outside does not count.
    """
    noise = s.noise
    near = noise.near_var + (noise.near_e - noise.now.mean_e) ** 2
    if noise.too_wide >= 0 and noise.n < TOO_WIDE_SAMPLES:
        noise.too_wide = noise.too_wide + 1 if TOO_WIDE_RATIO * near < noise.now.var_e else 0
    if noise.too_wide >= TOO_WIDE_LOOKS:
        relearn_noise(s, WARM_UP_SAMPLES)
        noise.too_wide = -1
    else:
        snapshot_noise(noise)


@jit
def follow_differences(noise, last, pv):
    """Take a sample into the variance of PV's second differences, whatever goes on.

    They see noise and hardly any process: the variance is 6 sigma^2 for white noise.
    """
    noise.n_d += 1
    n = noise.n_d - 2
    if n < 1:
        return
    d = pv - last.pv - last.pv_change
    d2 = d * d
    if n > 3 and noise.var_d > 0.0:  # a glitch, or a jump of PV, is no noise
        d2 = min(d2, (16.0 if n > WARM_UP_SAMPLES else GLITCH_MEAN_SIZES**2) * noise.var_d)
    noise.var_d += max(1.0 / n, LONG_WEIGHT) * (d2 - noise.var_d)


@jit
def white_sd(noise):
    """Return the standard deviation of PV's white noise [PV]."""
    return np.sqrt(noise.var_d / 6.0)


@jit
def quiet_sd(noise):
    """Return the standard deviation of the error when quiet, as far as known [PV]."""
    if noise.n < WARM_UP_SAMPLES // 2:
        return white_sd(noise)
    if noise.too_wide > 0:  # what is known may be an upset's
        return np.sqrt(min(noise.now.var_e, TOO_WIDE_RATIO * noise.near_var))
    return np.sqrt(noise.now.var_e)


@jit
def _stay_outside(s):
    """Count a sample outside of the band."""
    s.noise.outside_run += 1
    s.noise.unrest += 1.0
    # until then it may be a load step in its beginnings: the baseline is still wanted
    if s.noise.outside_run > RING_SAMPLES or (s.setpoint.moves > 0 and s.baseline.n < RAMP_CALM_SAMPLES):
        s.baseline.n = 0
    if s.noise.unrest > OUTSIDE_SAMPLES:
        relearn_noise(s, OUTSIDE_SAMPLES)


@jit
def _update_error(now, short, e, w, most, known):
    """Take a quiet sample's error and its short average into their means and variances, with weight ``w``."""
    d = min(max(e - now.mean_e, -most), most)
    if not known or d * d <= 9.0 * now.var_e or now.var_e == 0.0:
        now.mean_e += w * d
        now.var_e += w * (d * d - now.var_e)
        now.abs_e += w * (abs(d) - now.abs_e)
    d = short - now.mean_s
    if known and d * d > 9.0 * now.var_s > 0.0:
        d = np.sign(d) * 3.0 * np.sqrt(now.var_s)
    d = min(max(d, -most), most)
    now.mean_s += w * d
    now.var_s += w * (d * d - now.var_s)


@jit
def _update_level(baseline, pv, op):
    """Take a quiet sample into the means of PV and OP."""
    baseline.n += 1
    w = 1.0 / baseline.n if baseline.n * BASELINE_WEIGHT < 1.0 else BASELINE_WEIGHT
    if baseline.n == 1:
        baseline.pv, baseline.op = pv, op
    baseline.pv += w * (pv - baseline.pv)
    baseline.op += w * (op - baseline.op)


@jit
def relearn_noise(s, least_n):
    """Forget the noise: the loop has another one now, to be known after so many samples (many, to see slow waves)."""
    s.noise.n = s.noise.snapshots = 0
    s.noise.least_n = least_n
    s.noise.unrest = 0.0


@jit
def snapshot_noise(noise):
    """Keep the error's noise as it is now; the snapshot before stays at hand."""
    if noise.snapshots == 0:
        noise.older = noise.now
    else:
        noise.older = noise.recent
    noise.recent = noise.now
    noise.snapshots += 1


@jit
def load_step_suspected(s):
    """Whether the short average of the error has left its band: a load step, or the plant's weather."""
    noise, older = s.noise, s.noise.older
    away = s.last.short_e - older.mean_s
    if away * away <= TRIGGER_SD * TRIGGER_SD * older.var_s:
        return False  # nearly always
    wider = 1.0 + 30.0 / (KNOWN_SAMPLES + SNAPSHOT_SAMPLES * max(noise.snapshots - 2, 0))
    # without noise the band would be nothing: the last event's tail, below its own settling band, is no load
    least = 0.5 * noise.quantum + TAIL_SHARE * abs(s.event.amplitude) + 1e-9 * abs(s.last.sp)
    band = TRIGGER_SD * wider * np.sqrt(older.var_s) + least
    return abs(away) > band and (s.setpoint.moves == 0 or s.baseline.n >= RAMP_CALM_SAMPLES)


@jit
def await_baseline(s):
    """Wait for a new baseline; what is known of the noise stays."""
    s.phase = WARMING
    s.baseline.n = 0
