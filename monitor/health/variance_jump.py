"""A signal's noise as the mean of its blocks' log variances: what stands out is cut; where that stays, it is a jump."""

from __future__ import annotations

from monitor.compiled import jit

VARIANCE_JUMP_LN = 1.0
"""Logarithm of a block's variance above the mean logarithm, at most; that of noise has a standard deviation of 0.3."""
VARIANCE_JUMP_BLOCKS = 8
"""Blocks that are cut, one after the other, after which the noise is another one, and learnt anew."""


@jit
def clipped(value, total, n):
    """Cut what lies far above the mean so far: a block with a step in it."""
    return min(value, total / n + VARIANCE_JUMP_LN) if n >= 1.0 else value


@jit
def blocks_in_jump(run, value, total, n, counts):
    """Return how many blocks in a row were cut, this one too; one that does not count ends no run."""
    if value <= clipped(value, total, n):
        return 0.0
    return run + 1.0 if counts else run
