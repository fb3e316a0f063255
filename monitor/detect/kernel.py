"""The compiled streaming kernel: one sample of one loop at a time, in O(1) memory and a few additions.

The same function serves a live frame (many loops, one sample each) and an audit (one loop, a million
samples); nothing in it depends on how the samples were batched. Types are inferred by numba.
"""

from __future__ import annotations

import numpy as np

from monitor.compiled import jit

from . import act
from .accept import accepted, follow_rate, keep_last, remember
from .baseline import await_baseline, restart_loop
from .buffer import end_blocks, fill, go_on_filling, hand_out_block
from .constants import (
    ALL_STRETCHES_SAMPLES,
    LAST_BLOCK_SAMPLES,
    LEAST_BLOCK_SAMPLES,
    OPENING_SAMPLES,
    RING_SAMPLES,
    ROWS_OF_SAMPLE,
    SLOTS_OF_SAMPLE,
    STRETCH_SAMPLES,
)
from .event import BY_END
from .phases import advance, end_early
from .setpoint import go_on_moving
from .state import STRETCH
from .window import append, begin, begin_load, close, confirm, drop


@jit
def run(stores, batch, at):
    """Run from sample ``at`` until the samples or the room for events end; return (next sample, events).

    What concerns one loop's numbers happens in `advance`, which says what is to be done with its window: so the
    quiet sample, which is nearly every one, touches nothing else.
    """
    n = 0
    for k in range(at, len(batch.time)):
        if n + ROWS_OF_SAMPLE > len(stores.out) or stores.n_free[0] < SLOTS_OF_SAMPLE:
            return k, n
        i = batch.loop[k]
        s, p = stores.state[i], stores.param[i]
        time, sp, pv, op, auto = batch.time[k], batch.sp[k], batch.pv[k], batch.op[k], batch.auto[k]
        missing = np.isnan(sp) and s.counts.ok > 0
        if missing:
            sp = s.last.sp  # a set point holds until it is said to have changed
        if not accepted(s, p, time, sp, pv, op, batch.quality[k]):
            continue
        todo = advance(s, stores.health[i], p, time, sp, pv, op, auto)
        if s.window.slot >= 0 and not todo & (act.CUT | act.DROP):
            append(s, stores.slab, time, sp, pv, op)
        if todo:
            n = apply_actions(todo, s, stores, n, i, time, sp, pv, op)
        more = fill(s.buffer, stores.blocks[i], s.clock.period, time, sp, pv, op, auto)
        if more:
            n = go_on_filling(s, stores, n, i, more, time, sp, pv, op, auto)
        keep_last(s, time, sp, pv, op, auto)
        s.clock.sp_missing_run = s.clock.sp_missing_run + 1 if missing else 0
        remember(s, stores.rings[i], time, sp, pv, op)
        m = s.ring_n
        if m & (RING_SAMPLES - 1) == 0 or (m < RING_SAMPLES and m >= 8 and m & (m - 1) == 0):
            # at 8, 16, 32, 64, then once a turn: a gateway that changes its rate is followed
            follow_rate(s, p, stores.rings[i])
        if m & (RING_SAMPLES - 1) == 0 or s.window.slot >= 0:
            n = hand_out_stretches(s, stores, n, i)
    return len(batch.time), n


@jit
def apply_actions(todo, s, stores, n, i, time, sp, pv, op):
    """Do with the window what `advance` asked for; return the number of events in ``out``."""
    if todo & act.DROP:
        drop(s, stores)
    if todo & act.CONFIRM:
        n = confirm(s, stores.out, n, i, time, sp)
    if todo & (act.CUT | act.COMPLETE):
        if s.buffer.levels[0].n >= LEAST_BLOCK_SAMPLES:
            n = hand_out_block(s, stores, n, i, 0, True)
        await_baseline(s)
        n = close(s, stores.health[i], stores.out, n, i)
    if todo & (act.BEGIN | act.BEGIN_LOAD):
        begin(s, stores, i, time)
        if todo & act.BEGIN_LOAD:
            begin_load(s, stores, i, time, pv)
        append(s, stores.slab, time, sp, pv, op)
    if todo & act.GO_ON:
        go_on_moving(s)
    return n


@jit
def hand_out_stretches(s, stores, n, i):
    """Hand out the ring where it has just been filled once more, or where an event has just opened in it."""
    ok = s.counts.ok
    if s.ring_n & (RING_SAMPLES - 1) == 0 and ok >= s.next_stretch:
        if ok > ALL_STRETCHES_SAMPLES:
            s.next_stretch = ok + min(ok, STRETCH_SAMPLES)
        n = hand_out_stretch(s, stores, n, i, 0)
    opened = s.window.slot >= 0 and ok - s.event.ok_before == OPENING_SAMPLES - 1
    if opened and s.ring_n >= RING_SAMPLES:
        n = hand_out_stretch(s, stores, n, i, OPENING_SAMPLES)
    return n


@jit
def hand_out_stretch(s, stores, n, i, after):
    """Hand out the ring as a stretch; return the number of rows in ``out``.

    The last ``after`` samples of it come after an event's onset.
    """
    stores.n_free[0] -= 1
    o = stores.out[n]
    o.what, o.row, o.slot, o.points = STRETCH, i, stores.free[stores.n_free[0]], RING_SAMPLES
    o.before, o.period = RING_SAMPLES - after, s.clock.period
    first = s.ring_n & (RING_SAMPLES - 1)
    rings, w = stores.rings[i], stores.slab[o.slot]
    o.onset = rings.time[first]
    o.end = rings.time[(first + RING_SAMPLES - 1) & (RING_SAMPLES - 1)]
    for k in range(RING_SAMPLES):
        j = (first + k) & (RING_SAMPLES - 1)
        w[k, 0] = (rings.time[j] - o.onset) * 1e-9
        w[k, 1], w[k, 2], w[k, 3] = rings.values[j, 0], rings.values[j, 1], rings.values[j, 2]
    return n + 1


@jit
def begin_anew(s):
    """Begin a loop anew at its last sample: what was known of it is, but none of its samples."""
    s.window.slot = -1
    restart_loop(s, s.last.time, s.last.sp, s.last.pv)


@jit
def flush(stores, i, cause):
    """Close a loop's open event for a cause from outside; return the number of events in ``out``."""
    s, n = stores.state[i], 0
    todo = end_early(s, cause, s.last.time, s.last.sp)
    if todo & act.DROP:
        drop(s, stores)
    if todo & act.CONFIRM:
        n = confirm(s, stores.out, n, i, s.last.time, s.last.sp)
    if todo & act.CUT:
        n = close(s, stores.health[i], stores.out, n, i)
    if todo:
        await_baseline(s)
    return end_blocks(s, stores, n, i, LAST_BLOCK_SAMPLES if cause == BY_END else LEAST_BLOCK_SAMPLES)
