"""The compiled streaming kernel: one sample of one loop at a time, in O(1) memory and a few additions.

The same function serves a live frame (many loops, one sample each) and an audit (one loop, a million
samples); nothing in it depends on how the samples were batched. Types are inferred by numba.
"""

from __future__ import annotations

import numpy as np

from monitor.contract.samples import GOOD, UNCERTAIN
from monitor.health.observe import observe

from .state import (
    AWAY,
    BASE,
    BEGIN,
    BEGIN_LOAD,
    BLIND,
    BY_GAP,
    BY_MODE,
    BY_STEP,
    CALM,
    CANDIDATE,
    COARSE,
    CONFIRM,
    CUT,
    DONE,
    DROP,
    EVENT,
    GLITCH,
    HALF_WAVES,
    KNOWN,
    LOAD_QUANTA,
    LOAD_STANDS_OUT,
    LOAD_STEP,
    LONG,
    MAX_GAP,
    MOVING,
    NOISE_FREE,
    OUTLIER,
    PACE,
    PATIENCE,
    QUIET,
    RAMP_CALM,
    RAMP_REST,
    REBASE,
    REGAP,
    RESTLESS,
    RING,
    ROUNDING,
    SAME_LEVEL,
    SHORT,
    SNAPSHOT,
    STEP_LASTS,
    STEP_MOVES,
    STEP_REST,
    STEP_STANDS_OUT,
    STILLER,
    TIMEOUT,
    TOO_LARGE,
    TRIGGER,
    UNREST,
    WARM_UP,
    WARMING,
    jit,
)
from .window import add, append, begin, begin_load, close, confirm, drop, lie_down


@jit
def run(
    state,
    health,
    param,
    ring,
    ring_time,
    coarse,
    coarse_time,
    slab,
    free,
    n_free,
    out,
    loop,
    time,
    sp,
    pv,
    op,
    auto,
    quality,
    at,
):
    """Run from sample ``at`` until the samples or the room for events end; return (next sample, events).

    What concerns one loop's numbers happens in `_step`, which says what is to be done with its window: so the
    quiet sample, which is nearly every one, touches nothing else.
    """
    n = 0
    for k in range(at, len(time)):
        # one sample closes one event, opens another, and takes one slot, at most
        if n + 2 > len(out) or n_free[0] == 0:
            return k, n
        i = loop[k]
        s = state[i]
        r = sp[k]
        held = np.isnan(r) and s.seen > 0
        if held:
            r = s.sp  # a set point holds until it is said to have changed
        if not _accept(s, param[i], time[k], r, pv[k], op[k], quality[k]):
            continue
        act = _step(s, health[i], param[i], time[k], r, pv[k], op[k], auto[k])
        if s.slot >= 0 and not act & (CUT | DROP):
            append(s, slab, time[k], r, pv[k], op[k])
        if act:
            n = _act(act, s, health[i], ring, ring_time, slab, free, n_free, out, n, i, time[k], r)
            if act & BEGIN_LOAD:
                begin_load(s, ring, ring_time, coarse, coarse_time, slab, i, time[k], pv[k])
            if act & (BEGIN | BEGIN_LOAD):
                append(s, slab, time[k], r, pv[k], op[k])
        _keep(s, time[k], r, pv[k], op[k], auto[k])
        s.blind = s.blind + 1 if held else 0
        _remember(s, i, ring, ring_time, coarse, coarse_time, time[k], r, pv[k], op[k])
        m = s.ringed
        if m & (RING - 1) == 0 or (m < RING and m >= 8 and m & (m - 1) == 0):
            # at 8, 16, 32, 64, then once a turn: a gateway that changes its rate is followed
            _follow_rate(s, param[i], ring_time, i)
    return len(time), n


@jit
def _remember(s, i, ring, ring_time, coarse, coarse_time, time, sp, pv, op):
    """Put a sample into the loop's rings."""
    j = s.ringed & (RING - 1)
    ring_time[i, j] = time
    ring[i, j, 0], ring[i, j, 1], ring[i, j, 2] = sp, pv, op
    j = (s.ringed // COARSE) & (RING - 1)
    b = s.ringed % COARSE
    if b == 0:
        coarse_time[i, j] = time
        coarse[i, j, 0], coarse[i, j, 1], coarse[i, j, 2] = sp, pv, op
    else:  # OP held from point to point is its mean
        coarse[i, j, 2] += (op - coarse[i, j, 2]) / (b + 1)
    s.ringed += 1


@jit
def _accept(s, p, time, sp, pv, op, quality):
    """Count a sample; True if it is good and newer than the loop's last."""
    if s.seen > 0 and time <= s.time:
        if time == s.time:
            s.duplicate += 1
            if pv != s.pv or sp != s.sp or op != s.op:
                s.conflict += 1
            return False
        if not _set_back(s, time):
            s.late += 1
            return False
    if quality < UNCERTAIN:
        s.bad_quality += 1
        s.spoilt += 1
        return False
    ok = p.pv_min < pv < p.pv_max and p.pv_min < sp < p.pv_max and abs(op) < TOO_LARGE
    if not ok:  # also NaN
        s.bad_value += 1
        s.spoilt += 1
        return False
    s.ok += 1
    if quality < GOOD:
        s.uncertain += 1
    s.lates = s.spoilt = 0
    return True


@jit
def _set_back(s, time):
    """Whether a late sample is one of so many, each soon after the last, that the source's clock was set back."""
    soon = 0 < time - s.late_at <= MAX_GAP * s.period * 1e9
    s.lates = s.lates + 1 if soon else 1
    s.late_at = time
    return s.lates > REBASE


@jit
def _step(s, h, p, time, sp, pv, op, auto):
    """Take in one good sample; return what to do with the loop's window, as a sum of actions."""
    if s.seen == 0:
        s.moved = time
        _restart(s, sp, pv)
        return 0
    back = time < s.time
    dt = 0.0 if back else (time - s.time) * 1e-9
    gap = back or (s.period > 0 and dt > MAX_GAP * s.period) or (s.blind > BLIND and sp != s.sp)
    observe(h, s, p, dt, gap, sp, pv, op, auto)
    if gap or s.gaps > 0:
        _count_gaps(s, time, dt, gap, back)
    if gap or not auto or not s.auto or (sp != s.held and _other_units(s, sp, pv)):
        return _break_off(s, BY_MODE if s.auto != auto and not gap else BY_GAP, sp, pv)
    if s.slot >= 0:
        _integrate(s, p, dt, pv)
    d = sp - pv - s.short
    if s.phase == QUIET and OUTLIER * OUTLIER * s.var_e < d * d < NOISE_FREE * NOISE_FREE * s.var_e:
        most = OUTLIER * (np.sqrt(s.var_e) + 0.5 * s.quantum + 2e-3 * abs(s.amplitude))
        d = min(max(d, -most), most)
    s.short += _weight(dt, s.period) * d
    if s.phase > QUIET:
        return _follow(s, time, dt, sp, pv)
    if s.warm < WARM_UP // 2:
        s.held = sp  # without a baseline no move is looked at, and the set point's jitter is not known
    elif _moves(s, sp) and s.period > 0:
        _start_moving(s, time, sp)
        return BEGIN
    if s.phase == QUIET and s.looks > 0 and s.based >= CALM and _suspicious(s):
        return BEGIN_LOAD
    _listen(s, sp - pv, pv, op)
    return 0


@jit
def _break_off(s, cause, sp, pv):
    """Begin anew; return what becomes of an open window."""
    act = 0
    if s.phase == CANDIDATE:
        act = DROP  # a set-point move that was cut off before it was confirmed
    elif s.phase == EVENT:
        _end(s, 2, cause, s.time)
        act = _cut(s)
    _restart(s, sp, pv)
    return act


@jit
def _count_gaps(s, time, dt, gap, back):
    """Take gaps for the sample period where there is nothing else, and a clock that was set back for what it is."""
    if back:
        s.rebased += 1
        s.moved = time
        return
    s.gaps = s.gaps + 1 if gap else 0
    s.least_gap = dt if s.gaps <= 1 else min(s.least_gap, dt)
    if s.gaps >= REGAP:
        s.period = s.least_gap
        s.gaps = 0


@jit
def _other_units(s, sp, pv):
    """Whether SP and PV jump together, as no process does: other units, or another tag. The error stays small."""
    step = sp - s.sp
    return abs(step) > 10.0 * np.sqrt(s.var_e) and abs(pv - s.pv - step) <= 0.1 * abs(step)


@jit
def _moves(s, sp):
    """Whether a set point is no longer where it last rested or moved to."""
    return sp != s.held and abs(sp - s.held) > SAME_LEVEL * np.sqrt(s.var_e) + ROUNDING * abs(sp)


@jit
def _start_moving(s, time, sp):
    """Note that a set point leaves its rest."""
    s.sp_from = s.held
    s.moves = 0
    _move(s, time, sp)


@jit
def _move(s, time, sp):
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
def _rests(s, time, least):
    """Whether a moving set point has come to rest [least: periods]."""
    need = max(least, PATIENCE * s.pace) if s.pace < RESTLESS else least
    return (time - s.moved) * 1e-9 > (need - 0.5) * s.period


@jit
def _keep(s, time, sp, pv, op, auto):
    """Make this sample the last one."""
    d = pv - s.pv
    if s.seen > 0 and d != 0.0 and (s.quantum == 0.0 or abs(d) < s.quantum):
        s.quantum = abs(d)
    s.dpv = d
    s.time, s.sp, s.pv, s.op, s.auto = time, sp, pv, op, 1 if auto else 0
    s.seen += 1


@jit
def _restart(s, sp, pv):
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
def _median_step(ring_time, i, ringed):
    """Sample period where none is given: the median step between the ring's times [s]."""
    m = min(ringed, RING)
    steps = np.empty(m - 1)
    for j in range(m - 1):
        steps[j] = (ring_time[i, (ringed - m + j + 1) % RING] - ring_time[i, (ringed - m + j) % RING]) * 1e-9
    return np.median(steps)


@jit
def _follow_rate(s, p, ring_time, i):
    """Take over the sample period as it is now, unless it is given; what averages knew of another is worth nothing."""
    if p.period != 0 and s.period == p.period:
        return
    period = max(_median_step(ring_time, i, s.ringed), p.period)
    if abs(period - s.period) > 0.2 * period and s.slot < 0:
        s.warm = s.based = s.away = s.looks = 0
        s.learn = WARM_UP
    s.period = period


@jit
def _follow(s, time, dt, sp, pv):
    """Move an eventful phase on by one sample; return what to do."""
    if s.phase == MOVING:
        if _moves(s, sp):
            _move(s, time, sp)
        elif _rests(s, time, RAMP_REST):
            _settle_down(s)
        return 0
    if s.phase == EVENT:
        if s.kind == LOAD_STEP:
            s.amplitude = max(s.amplitude, abs(s.short - s.mean_s))
        if _moves(s, sp) and abs(sp - s.held) > 0.02 * abs(s.amplitude):
            _end(s, 2, BY_STEP, time)
            act = _cut(s) | BEGIN
            _start_moving(s, time, sp)
            return act
        if not _lies_still(s, time, dt, sp - pv):
            return 0
        s.moves = 0
        if _cut(s) == CUT:
            return DONE
        _settle_down(s)
        return DROP
    return _come_to_rest(s, time, sp)


@jit
def _come_to_rest(s, time, sp):
    """Follow a set point that has begun to move: a step, a ramp, or nothing; return what to do."""
    if _moves(s, sp):
        s.moves += 1
        s.held = sp
        lasted = (time - s.onset) * 1e-9 / s.period
        if s.moves > STEP_MOVES or lasted > STEP_LASTS:
            s.pace = min(s.pace, lasted / (s.moves - 1))
            s.phase = MOVING
        s.moved = time
        return DROP if s.phase == MOVING else 0
    if not _rests(s, time, STEP_REST):
        return 0
    s.amplitude = sp - s.sp_from
    if abs(s.amplitude) > max(STEP_STANDS_OUT * max(s.sd_e, 0.99 * s.quantum), ROUNDING * abs(sp)):
        return CONFIRM
    s.phase = QUIET  # the set point moved, but within the noise
    return DROP


@jit
def _act(act, s, h, ring, ring_time, slab, free, n_free, out, n, i, time, sp):
    """Do with the window what `_step` asked for; return the number of events in ``out``."""
    if act & DROP:
        drop(s, free, n_free)
    if act & CONFIRM:
        n = confirm(s, out, n, i, time, sp)
    if act & (CUT | DONE):
        _settle_down(s)
        n = close(s, out, n, i)
        _stamp(out[n - 1], h, s)
    if act & (BEGIN | BEGIN_LOAD):
        begin(s, ring, ring_time, slab, free, n_free, i, time)
    return n


@jit
def _stamp(o, h, s):
    """Put the loop's health and state of this moment on a closed event."""
    o.loop_health = h
    o.loop_state = s


@jit
def _end(s, state, cause, time):
    s.end_state, s.end_cause, s.end = state, cause, time


@jit
def _weight(dt, period):
    """Weight of the short average over ``dt``: two missed samples weigh as two."""
    if period <= 0 or abs(dt - period) < 1e-3 * period:
        return SHORT  # the power costs as much as all the rest
    return 1.0 - (1.0 - SHORT) ** (dt / period)


@jit
def _listen(s, e, pv, op):  # noqa: C901 (a line for each average)
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
            _learn_anew(s, AWAY)
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
        _look(s)


@jit
def _learn_anew(s, learn):
    """Forget the noise: the loop has another one now, to be known after ``learn`` samples (many, to see slow waves)."""
    s.warm = s.looks = 0
    s.learn = learn
    s.unrest = 0.0


@jit
def _look(s):
    """Keep the error's noise as it is now; the look before stays at hand."""
    first = s.looks == 0
    s.mean_e_2, s.var_e_2 = (s.mean_e, s.var_e) if first else (s.mean_e_1, s.var_e_1)
    s.mean_s_2, s.var_s_2 = (s.mean_s, s.var_s) if first else (s.mean_s_1, s.var_s_1)
    s.abs_e_2 = s.abs_e if first else s.abs_e_1
    s.mean_e_1, s.var_e_1, s.abs_e_1, s.mean_s_1, s.var_s_1 = s.mean_e, s.var_e, s.abs_e, s.mean_s, s.var_s
    s.looks += 1


@jit
def _suspicious(s):
    """Whether the short average of the error has left its band: a load step, or the plant's weather."""
    if (s.short - s.mean_s_2) ** 2 <= TRIGGER * TRIGGER * s.var_s_2:
        return False  # nearly always
    wider = 1.0 + 30.0 / (KNOWN + SNAPSHOT * max(s.looks - 2, 0))
    # without noise the band would be nothing: the last event's tail, below its own settling band, is no load
    least = 0.5 * s.quantum + 2e-3 * abs(s.amplitude) + 1e-9 * abs(s.sp)
    band = TRIGGER * wider * np.sqrt(s.var_s_2) + least
    return abs(s.short - s.mean_s_2) > band and (s.moves == 0 or s.based >= RAMP_CALM)


@jit
def _cut(s):
    """Say what becomes of an event that is over: a load step no larger than what weather brings is forgotten."""
    nothing = s.amplitude < max(LOAD_STANDS_OUT * np.sqrt(s.var_s), LOAD_QUANTA * s.quantum)
    return DROP if s.kind == LOAD_STEP and nothing else CUT


@jit
def _settle_down(s):
    """Wait for a new baseline; what is known of the noise stays."""
    s.phase = WARMING
    s.based = 0


@jit
def _integrate(s, p, dt, pv):
    """Account for one sample of an open event."""
    add(s, s.sp, s.pv, pv, s.op, dt)
    s.good += dt if s.period == 0 else min(dt, 1.5 * s.period)
    if s.op <= p.op_low or s.op >= p.op_high:
        s.saturated += dt


@jit
def _lies_still(s, time, dt, e):
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
        lie_down(s, time)
    rest = (time - s.still) * 1e-9
    busy = (s.still - s.onset) * 1e-9
    offset = abs(s.sum_e)
    patience = 1.0 if offset <= 0.5 * band * s.sum_t else 4.0
    if offset > (0.5 if s.kind == LOAD_STEP else 0.8) * size * s.sum_t:
        patience = 20.0  # PV has hardly begun, or has not begun to return: dead time, or a long lag
    if rest >= patience * max(WARM_UP * s.period, 0.5 * busy):
        _end(s, 1, 0, time)
        if s.high - s.low < STILLER * np.sqrt(s.var_s) and rest > KNOWN * s.period:
            _learn_anew(s, WARM_UP)
        return True
    if rest + busy > TIMEOUT * s.period or s.waves > HALF_WAVES:
        _end(s, 3, 0, time)
        _learn_anew(s, AWAY)
        return True
    return False


@jit
def _turn(s, side):
    """Count half waves: the error has left the band in which it lay, upwards or downwards."""
    if side != s.side:
        s.waves += 1
        s.side = side


@jit
def flush(state, health, free, n_free, out, i, cause):
    """Close a loop's open event for a cause from outside; return the number of events in ``out``."""
    s = state[i]
    if s.phase == CANDIDATE:
        drop(s, free, n_free)
        _settle_down(s)
    if s.phase != EVENT:
        return 0
    if _cut(s) == DROP:
        drop(s, free, n_free)
        _settle_down(s)
        return 0
    _end(s, 2, cause, s.time)
    _settle_down(s)
    n = close(s, out, 0, i)
    _stamp(out[0], health[i], s)
    return n
