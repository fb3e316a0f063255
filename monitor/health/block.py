"""What is done in blocks of samples or of averages: their length, and how they correlate (compiled)."""

from __future__ import annotations

from monitor.compiled import jit

BLOCK_LENGTH = 64
"""Values in a block: three cycles of the longest period of a level. 4^3, so that one counter serves all levels."""
HORIZON_S = 14 * 86400.0
"""Time after which sums are halved [s]: a loop is judged by its recent weeks."""


@jit
def add_products(x, out):
    """Add the products of a block with itself, shifted by 0, 1, 2, ... samples; beyond the block ``x`` is zero."""
    for i in range(BLOCK_LENGTH):
        v, shifted = x[i], x[i : i + len(out)]
        for lag in range(len(out)):  # over lags the compiler takes eight at a time, over samples none
            out[lag] += v * shifted[lag]
