"""A loop's blocks: what came in a row in automatic, sample by sample and in averages, until a block is full (compiled).

What is wrong with a loop (a valve that sticks, a cycle, no answer) shows in some hundred samples in a row, whatever
happens in them. Each loop fills a block of its samples and one of averages of sixteen; a full one is handed out. A gap
or manual ends a block, and one that is not long enough to show anything is let go. Values are kept as differences
from the block's first sample, so that 32 bits hold the noise of a PV that is far from zero.
"""

from __future__ import annotations

from monitor.compiled import jit

from .constants import BLOCK_SAMPLES, LEAST_BLOCK_SAMPLES, LEVEL_SAMPLES, MAX_GAP_PERIODS
from .state import BLOCK


@jit
def fill(s, stores, n, i, time, sp, pv, op, auto):
    """Put a sample into the loop's blocks; return the number of rows in ``out``."""
    b, period = s.buffer, s.clock.period
    if period <= 0.0:
        return n
    dt = (time - b.time) * 1e-9
    if (
        not auto
        or dt > MAX_GAP_PERIODS * period
        or dt < 0.0
        or not 0.5 * b.period <= period <= 2.0 * b.period
    ):
        n = end_blocks(s, stores, n, i, LEAST_BLOCK_SAMPLES)
        b.period = period
        dt = period
    b.time = time
    if not auto:
        return n
    b.clock += dt  # a sample that is missing is filled with the next one's value
    for _ in range(max(int(b.clock / b.period + 0.5), 0)):
        b.clock -= b.period
        n = _enter(s, stores, n, i, 0, sp, pv, op)
        b.sums[0] += sp
        b.sums[1] += pv
        b.sums[2] += op
        b.summed += 1
        if b.summed == LEVEL_SAMPLES:
            share = 1.0 / LEVEL_SAMPLES
            n = _enter(s, stores, n, i, 1, share * b.sums[0], share * b.sums[1], share * b.sums[2])
            b.sums[:] = 0.0
            b.summed = 0
    return n


@jit
def _enter(s, stores, n, i, level, sp, pv, op):
    """Put values into the block of a level, and hand it out where it is full."""
    own = s.buffer.levels[level]
    if own.n == 0:
        own.start = s.buffer.time
        own.origin[0], own.origin[1], own.origin[2] = sp, pv, op
    values = stores.blocks[i, level, own.n]
    values[0], values[1], values[2] = sp - own.origin[0], pv - own.origin[1], op - own.origin[2]
    own.n += 1
    return hand_out_block(s, stores, n, i, level, False) if own.n == BLOCK_SAMPLES else n


@jit
def end_blocks(s, stores, n, i, least):
    """End what fills; hand out what has ``least`` values."""
    b = s.buffer
    for level in range(len(b.levels)):
        if b.levels[level].n >= least:
            n = hand_out_block(s, stores, n, i, level, False)
        b.levels[level].n = 0
    b.sums[:] = 0.0
    b.summed = 0
    b.clock = 0.0
    return n


@jit
def hand_out_block(s, stores, n, i, level, so_far):
    """Hand out a level's block; return the number of rows in ``out``. It begins anew, unless it is shown ``so_far``."""
    own = s.buffer.levels[level]
    stores.n_free[0] -= 1
    o = stores.out[n]
    o.what, o.row, o.slot, o.points = BLOCK, i, stores.free[stores.n_free[0]], own.n
    o.number, o.state, o.period = level, int(so_far), s.buffer.period * LEVEL_SAMPLES**level
    o.onset, o.end = own.start, s.buffer.time
    w, values = stores.slab[o.slot], stores.blocks[i, level]
    for k in range(own.n):
        for c in range(3):
            w[k, 1 + c] = own.origin[c] + values[k, c]
    if not so_far:
        own.n = 0
    return n + 1
