"""A loop's rows one by one: handed on, kept back until it is known how they come, or filled up (compiled)."""

from __future__ import annotations

import numpy as np

from monitor.compiled import jit
from monitor.contract.samples import QUALITY_GOOD, QUALITY_UNCERTAIN

from .look import is_regular, look, median_step, steps_of
from .state import (
    COLLECTING,
    EARLY_LOOKS,
    EARLY_SHARE,
    HOLDING,
    IRREGULAR_RATIO,
    LATE_ROWS,
    LOOK_ROWS,
    MOST_BACKOFF,
    MOST_HELD_ROWS,
    NEXT_ROWS,
    ODD_ROWS,
    PASSING,
    QUIET_BEATS,
    REGULAR_ROWS,
    RING_ROWS,
    SAME_BAND_SHARE,
    SAME_SHARE,
    SEEN_ROWS,
    SLOW_NS,
    WATCHING,
)


@jit
def passes(state, batch, at):
    """Take in rows from ``at`` on that are handed on as they are; return the first that is not."""
    for k in range(at, len(batch.time)):
        s = state[batch.loop[k]]
        time, sp, pv, op = batch.time[k], batch.sp[k], batch.pv[k], batch.op[k]
        if s.mode != PASSING or not is_good(s, time, pv, op, batch.quality[k]) or not goes_on(s, time):
            return k
        keep(s, time, sp, pv, op, batch.auto[k])
    return len(batch.time)


@jit
def is_good(s, time, pv, op, quality):
    """Whether a row is good and newer than the loop's last."""
    if s.rows > 0 and time <= s.time:
        return False
    return quality >= QUALITY_UNCERTAIN and np.isfinite(pv) and np.isfinite(op)


@jit
def goes_on(s, time):
    """Whether a good row of a loop that is passing comes as those before; its interval is counted if so."""
    step = time - s.time
    if s.rows < 2:
        s.usual = step
        return s.rows == 0 or step < SLOW_NS or s.given > 0
    if abs(step - s.usual) <= SAME_SHARE * s.usual:
        s.looked += 1
        return True
    if s.looked >= LOOK_ROWS:
        s.backoff = max(s.backoff, 1)
    far = step > IRREGULAR_RATIO * s.usual or IRREGULAR_RATIO * step < s.usual
    early = s.usual >= SLOW_NS and step < EARLY_SHARE * s.usual
    if (s.backoff == 0 and far) or (s.backoff == 1 and early):
        return False
    if s.looked >= LOOK_ROWS * max(s.backoff, 1):
        s.looked = s.odd = 0
    if s.odd + 1 >= ODD_ROWS * max(s.backoff, 1):
        return False
    s.looked += 1
    s.odd += 1
    # the usual interval is followed slowly up and down: the median of all
    s.usual += max(s.usual >> 4, 1) if step > s.usual else -(s.usual >> 4)
    return True


@jit
def keep(s, time, sp, pv, op, auto):
    """Make a good row the loop's last one; a set point holds until another comes."""
    s.time, s.pv, s.op, s.auto = time, pv, op, auto
    if np.isfinite(sp):
        s.sp = sp
    s.rows = min(s.rows + 1, 2)
    s.good, s.late = 1, 0


@jit
def take(state, ring, batch, at, out):
    """Take in rows from ``at`` on, and put out what is due; return (next row, rows in ``out``, loop or -1).

    It stops before a row for which ``out`` has no room, and where what is known of a loop changes, which it names: its
    rows that wait are to be let go then. What was put out before was told by what was known before.
    """
    n = 0
    for k in range(at, len(batch.time)):
        i, time = batch.loop[k], batch.time[k]
        s, rows = state[i], ring[i]
        if n == len(out.time):
            return k, n, -1
        if not is_good(s, time, batch.pv[k], batch.op[k], batch.quality[k]):
            if lets_go(s, time):
                return k, n, i
            n = put(batch, k, out, n)
            continue
        if s.mode == PASSING and not goes_on(s, time):
            begin_to_look(s, rows, time)
        if s.mode == HOLDING and s.good:
            n, done = hold(s, i, s.time, s.sp, s.op, s.auto != 0, time, out, n)
            if not done:
                return k, n, -1
        keep(s, time, batch.sp[k], batch.pv[k], batch.op[k], batch.auto[k])
        if s.mode != WATCHING:
            n = hand_on(s, batch, k, out, n)
        if s.mode != PASSING and is_known(s, rows, batch.auto[k], batch.quality[k]):
            return k + 1, n, i
    return len(batch.time), n, -1


@jit
def lets_go(s, time):
    """Take note of a bad or late row; True where the loop's rows are no more to be held or kept back for it.

    Those that wait must not be older than a late one that is handed on, and a clock may have been set back.
    """
    if s.rows == 0 or time > s.time:
        s.good = 0
        return False
    s.late += 1
    if s.mode == WATCHING or (s.mode == HOLDING and s.late > LATE_ROWS):
        pass_on(s)
        return True
    return False


@jit
def hand_on(s, batch, k, out, n):
    """Put a good row out, which is the loop's last one; return the number of rows in ``out``."""
    s.out_time = s.time
    n = put(batch, k, out, n)
    if s.mode == HOLDING:
        out.pv[n - 1] = show(s, s.pv)
    return n


@jit
def put(batch, k, out, n):
    """Put a row out as it is; return the number of rows in ``out``."""
    out.loop[n], out.time[n], out.sp[n], out.pv[n] = batch.loop[k], batch.time[k], batch.sp[k], batch.pv[k]
    out.op[n], out.auto[n], out.quality[n] = batch.op[k], batch.auto[k], batch.quality[k]
    return n + 1


@jit
def is_known(s, rows, auto, quality):
    """Write the loop's last row to its ring; True where that has changed what is known of the way its rows come."""
    w = rows[s.n]
    w.time, w.sp, w.pv, w.op, w.auto, w.quality = s.time, s.sp, s.pv, s.op, auto, quality
    s.n += 1
    if s.mode != WATCHING:
        s.next = s.n
    if s.mode == WATCHING and s.n == REGULAR_ROWS and all_the_same(rows[: s.n]):
        s.usual, s.backoff = rows[1].time - rows[0].time, 1
        pass_on(s)
        return True
    if s.n < SEEN_ROWS or s.n % NEXT_ROWS:
        return False
    seen = rows[s.n - SEEN_ROWS : s.n]
    return is_over(s, seen) if s.mode == HOLDING else is_decided(s, rows, seen)


@jit
def is_over(s, seen):
    """Whether a loop that was holding has gone over to rows at a rate."""
    if s.n == RING_ROWS:
        s.n = s.next = 0
    if not is_regular(seen, s.period):
        return False
    s.n = s.next = 0
    pass_on(s)
    return True


@jit
def is_decided(s, rows, seen):
    """Whether it is decided how a loop's rows come: by exception, or, after some looks, not."""
    if judge(s, rows, seen):
        return True
    if s.n < RING_ROWS:
        return False
    give_up(s, seen)
    return True


@jit
def begin_to_look(s, rows, time):
    """Look at what comes from now on; the loop's last row, which has been handed on, is the first to be looked at."""
    quiet = s.usual >= SLOW_NS and time - s.time < EARLY_SHARE * s.usual
    s.mode = WATCHING if s.backoff == 0 or (quiet and s.backoff == 1) else COLLECTING
    w = rows[0]
    w.time, w.sp, w.pv, w.op, w.auto, w.quality = s.time, s.sp, s.pv, s.op, s.auto != 0, QUALITY_GOOD
    s.out_time, s.n, s.next = s.time, 1, 1


@jit
def judge(s, rows, seen):
    """Judge by some rows whether all in the ring come by exception; those that wait are to be let go if so."""
    period, beat, band = look(seen, s.given)
    if period == 0:
        return False
    if s.mode == WATCHING:
        s.shown = rows[0].pv
    else:
        s.shown = s.pv
        s.n = s.next = 0
    s.mode, s.period, s.beat, s.band, s.backoff = HOLDING, period, beat, band, 1
    return True


@jit
def give_up(s, seen):
    """Hand on rows as they come, for they show nothing else; they are looked at again after a while."""
    s.looks += 1
    s.backoff = min(max(2 * s.backoff, 2), MOST_BACKOFF) if s.looks > EARLY_LOOKS else 1
    waits = s.mode == WATCHING
    s.usual = median_step(seen)
    pass_on(s)
    if s.looks <= EARLY_LOOKS and not is_regular(seen, s.usual):
        s.mode = COLLECTING
    if not waits:
        s.n = s.next = 0


@jit
def pass_on(s):
    """From now on, hand on rows as they come, those that wait first."""
    s.mode, s.period, s.beat, s.band = PASSING, 0, 0, 0.0
    s.looked = s.odd = s.late = 0


@jit
def all_the_same(rows):
    """Whether rows come at one interval."""
    first = rows[1].time - rows[0].time
    return np.abs(steps_of(rows) - first).max() <= SAME_SHARE * first


@jit
def let_go(s, rows, i, out):
    """Put out the rows that wait, filled where the loop is holding; return (rows in ``out``, whether that is all)."""
    n = 0
    while s.next < s.n:
        w, v = rows[s.next], rows[s.next - 1 if s.next > 0 else 0]
        if s.mode == HOLDING and s.next > 0:
            n, done = hold(s, i, v.time, v.sp, v.op, v.auto, w.time, out, n)
            if not done:
                return n, False
        if n == len(out.time):
            return n, False
        out.loop[n], out.time[n], out.sp[n], out.pv[n], out.op[n] = i, w.time, w.sp, w.pv, w.op
        out.auto[n], out.quality[n] = w.auto, w.quality
        if s.mode == HOLDING:
            out.pv[n] = show(s, w.pv)
        s.out_time = w.time
        s.next += 1
        n += 1
    s.n = s.next = 0
    return n, True


@jit
def show(s, pv):
    """Return the PV that is handed on of a loop that is holding: the last one, unless it has moved."""
    if abs(pv - s.shown) >= SAME_BAND_SHARE * s.band:
        s.shown = pv
    return s.shown


@jit
def hold(s, i, since, sp, op, auto, until, out, n):
    """Put out a row's values again and again until the next row; return (rows in ``out``, whether there was room).

    Nothing is held across a silence longer than those of a loop that has nothing to report.
    """
    longest = QUIET_BEATS * s.beat if s.beat > 0 else float(MOST_HELD_ROWS * s.period)
    if until - since > longest:
        return n, True
    while s.out_time + s.period + s.period // 2 <= until:
        if n + 1 >= len(out.time):  # one place is left for the row itself
            return n, False
        s.out_time += s.period
        out.loop[n], out.time[n], out.sp[n], out.pv[n], out.op[n] = i, s.out_time, sp, s.shown, op
        out.auto[n], out.quality[n] = auto, QUALITY_GOOD
        s.added += 1
        n += 1
    return n, True
