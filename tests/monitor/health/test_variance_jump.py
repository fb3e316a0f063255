"""What stands out of a signal's noise, once and for good."""

from __future__ import annotations

import numpy as np

from monitor.health.variance_jump import VARIANCE_JUMP_BLOCKS, VARIANCE_JUMP_LN, blocks_in_jump, clipped


def test_what_stands_out_is_cut():
    """Above the mean of what is known, if anything is; never below it."""
    assert clipped(7.0, 0.0, 0.0) == 7.0
    assert clipped(7.0, 6.0, 3.0) == 2.0 + VARIANCE_JUMP_LN
    assert clipped(-7.0, 6.0, 3.0) == -7.0


def test_a_jump_is_what_stands_out_for_long():
    """Noise of one size ends a run; a block that does not count neither makes nor ends one."""
    run = 0.0
    for k in range(VARIANCE_JUMP_BLOCKS):
        run = blocks_in_jump(run, 7.0, 6.0, 3.0, True)
        assert run == k + 1
    assert blocks_in_jump(run, 7.0, 6.0, 3.0, False) == run
    assert blocks_in_jump(run, 2.0, 6.0, 3.0, True) == 0


def test_noise_of_one_size_makes_no_jump():
    """In a hundred thousand blocks of 64 samples."""
    values = np.log(np.random.default_rng(0).chisquare(64, 100_000) / 64)
    run = total = most = 0.0
    for n, value in enumerate(values):
        run = blocks_in_jump(run, value, total, float(n), True)
        total += clipped(value, total, float(n))
        most = max(most, run)
    assert most < 3
