"""The compiled streaming kernel: one sample of one loop at a time, in O(1) memory and a few additions.

The same function serves a live frame (many loops, one sample each) and an audit (one loop, a million
samples); nothing in it depends on how the samples were batched. Types are inferred by numba.
"""

from __future__ import annotations

import numpy as np

from monitor.compiled import jit

from .accept import accepted, follow_rate, keep_last, remember
from .baseline import await_baseline
from .phases import advance, apply_actions, cut_or_drop, end_event
from .state import BEGIN, BEGIN_LOAD, CANDIDATE, CUT, DROP, EVENT, RING
from .window import append, begin_load, close, drop


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
        if not accepted(s, param[i], time[k], r, pv[k], op[k], quality[k]):
            continue
        act = advance(s, health[i], param[i], time[k], r, pv[k], op[k], auto[k])
        if s.slot >= 0 and not act & (CUT | DROP):
            append(s, slab, time[k], r, pv[k], op[k])
        if act:
            n = apply_actions(act, s, health[i], ring, ring_time, slab, free, n_free, out, n, i, time[k], r)
            if act & BEGIN_LOAD:
                begin_load(s, ring, ring_time, coarse, coarse_time, slab, i, time[k], pv[k])
            if act & (BEGIN | BEGIN_LOAD):
                append(s, slab, time[k], r, pv[k], op[k])
        keep_last(s, time[k], r, pv[k], op[k], auto[k])
        s.blind = s.blind + 1 if held else 0
        remember(s, i, ring, ring_time, coarse, coarse_time, time[k], r, pv[k], op[k])
        m = s.ringed
        if m & (RING - 1) == 0 or (m < RING and m >= 8 and m & (m - 1) == 0):
            # at 8, 16, 32, 64, then once a turn: a gateway that changes its rate is followed
            follow_rate(s, param[i], ring_time, i)
    return len(time), n


@jit
def flush(state, health, free, n_free, out, i, cause):
    """Close a loop's open event for a cause from outside; return the number of events in ``out``."""
    s = state[i]
    if s.phase == CANDIDATE:
        drop(s, free, n_free)
        await_baseline(s)
    if s.phase != EVENT:
        return 0
    if cut_or_drop(s) == DROP:
        drop(s, free, n_free)
        await_baseline(s)
        return 0
    end_event(s, 2, cause, s.time)
    await_baseline(s)
    return close(s, health[i], out, 0, i)
