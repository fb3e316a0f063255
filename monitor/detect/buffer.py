"""A loop's blocks: what came in a row in automatic, sample by sample and in averages, until a block is full (compiled).

What is wrong with a loop (a valve that sticks, a cycle, no answer) shows in some hundred samples in a row, whatever
happens in them. Each loop fills a block of its samples and one of averages of sixteen; a full one is handed out. A gap
or manual ends a block, and one that is not long enough to show anything is let go. Values are kept as differences
from the block's first sample, so that 32 bits hold the noise of a PV that is far from zero.
"""

from __future__ import annotations

from monitor.compiled import jit

from .constants import BLOCK_SAMPLES, LEAST_BLOCK_SAMPLES, LEVEL_SAMPLES, LEVELS, MAX_GAP_PERIODS
from .state import BLOCK


@jit
def fill(b, blocks, period, time, sp, pv, op, auto):
    """Put a sample into the loop's blocks, of which ``b`` keeps count, and samples that are missing before it.

    Returns 0, nearly always; -1 where it ends the blocks; and where one is full, the values still to be put plus one:
    `go_on_filling` knows how.
    """
    values = _values_of(b, period, time, auto)
    for k in range(values):
        if _enter(b, blocks, sp, pv, op):
            return values - k
    return min(values, 0)


@jit
def go_on_filling(s, stores, n, i, more, time, sp, pv, op, auto):
    """Hand out what `fill` found full, or ended, and put what it left; return the number of rows in ``out``."""
    b, blocks = s.buffer, stores.blocks[i]
    if more > 0:
        n = _hand_out_full(s, stores, n, i)
        more -= 1
    else:
        n = end_blocks(s, stores, n, i, LEAST_BLOCK_SAMPLES)
        b.period, b.time = s.clock.period, time
        more = 1 if auto else 0
    for _ in range(more):
        if _enter(b, blocks, sp, pv, op):
            n = _hand_out_full(s, stores, n, i)
    return n


@jit
def _values_of(b, period, time, auto):
    """Return how many values a sample adds to the blocks; -1 where it ends them."""
    if period <= 0.0:
        return 0
    dt = (time - b.time) * 1e-9
    if (
        not auto
        or dt > MAX_GAP_PERIODS * period
        or dt < 0.0
        or not 0.5 * b.period <= period <= 2.0 * b.period
    ):
        return -1
    b.time = time
    b.clock += dt
    n = max(int(b.clock / b.period + 0.5), 0)
    for _ in range(n):
        b.clock -= b.period
    return n


@jit
def _enter(b, blocks, sp, pv, op):
    """Put a value into the blocks; whether one is full."""
    _put(b, 0, blocks, sp, pv, op)
    sums = b.sums
    sums[0] += sp
    sums[1] += pv
    sums[2] += op
    b.summed += 1
    if b.summed == LEVEL_SAMPLES:
        share = 1.0 / LEVEL_SAMPLES
        _put(b, 1, blocks, share * sums[0], share * sums[1], share * sums[2])
        sums[0] = sums[1] = sums[2] = 0.0
        b.summed = 0
    return b.levels[0].n == BLOCK_SAMPLES or b.levels[1].n == BLOCK_SAMPLES


@jit
def _put(b, level, blocks, sp, pv, op):
    """Put a value into the block of a level."""
    own = b.levels[level]
    origin, values, at = own.origin, blocks.values, own.n
    if at == 0:
        own.start = b.time
        origin[0], origin[1], origin[2] = sp, pv, op
    values[level, at, 0] = sp - origin[0]
    values[level, at, 1] = pv - origin[1]
    values[level, at, 2] = op - origin[2]
    own.n = at + 1


@jit
def _hand_out_full(s, stores, n, i):
    """Hand out the blocks that are full; return the number of rows in ``out``."""
    for level in range(LEVELS):
        if s.buffer.levels[level].n == BLOCK_SAMPLES:
            n = hand_out_block(s, stores, n, i, level, False)
    return n


@jit
def end_blocks(s, stores, n, i, least):
    """End what fills; hand out what has ``least`` values."""
    b = s.buffer
    for level in range(LEVELS):
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
    w, values = stores.slab[o.slot], stores.blocks[i].values
    for k in range(own.n):
        for c in range(3):
            w[k, 1 + c] = own.origin[c] + values[level, k, c]
    if not so_far:
        own.n = 0
    return n + 1
