"""Blocks: each sample is in one, once; gaps and manual end them; the same whatever the batches."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from monitor.contract.loops import Loop
from monitor.contract.samples import Samples
from monitor.detect.constants import BLOCK_SAMPLES, LEAST_BLOCK_SAMPLES, LEVEL_SAMPLES
from monitor.detect.detector import Detector
from monitor.health.diagnosis import Block

NS = 10**9
START = 1_767_225_600 * NS


def samples_of(time: Any, sp: Any, pv: Any, op: Any, auto: Any = True) -> Samples:
    n = len(time)
    auto = np.broadcast_to(auto, n)
    return Samples.of(np.zeros(n, np.int64), START + np.asarray(time) * NS, sp, pv, op, auto)


def blocks_of(samples: Samples, cuts: Any = ()) -> list[Block]:
    """All blocks but those so far, in the order in which they were handed out."""
    detector = Detector([Loop(name="L")])
    edges = [0, *sorted(cuts), len(samples)]
    for first, last in pairwise(edges):
        detector.run(samples.take(slice(first, last)))
    detector.flush()
    return [block for block in detector.take_blocks() if not block.so_far]


def noise(n: int, seed: int = 1) -> Any:
    return np.random.default_rng(seed).normal(size=n)


N = 5000
QUIET = samples_of(np.arange(N), np.full(N, 50.0), 50 + noise(N), 30 + noise(N, 2))


def test_a_block_holds_each_sample_once_and_the_averages_of_sixteen():
    """From when the period is known; the last block is what is left."""
    blocks = blocks_of(QUIET)
    fine = [b for b in blocks if b.level == 0]
    first = int((fine[0].start - START) // NS)
    pv = np.concatenate([b.pv for b in fine])
    assert np.allclose(pv, QUIET.pv[first : first + len(pv)], atol=1e-6)
    assert first < 20
    assert N - first - len(pv) < 64
    assert [len(b.pv) for b in fine[:-1]] == [BLOCK_SAMPLES] * (len(fine) - 1)
    coarse = next(b for b in blocks if b.level == 1)
    n = len(coarse.pv) * LEVEL_SAMPLES
    means = QUIET.pv[first : first + n].reshape(-1, LEVEL_SAMPLES).mean(axis=1)
    assert np.allclose(coarse.pv, means, atol=1e-6)
    assert coarse.period == pytest.approx(LEVEL_SAMPLES)


def test_noise_far_from_zero_is_kept():
    """32 bits hold seven digits; what they hold is the difference from the first sample."""
    pv = 1e7 + 1e-3 * noise(N)
    block = blocks_of(samples_of(np.arange(N), np.full(N, 1e7), pv, 30 + noise(N)))[0]
    first = int((block.start - START) // NS)
    assert np.abs(block.pv - pv[first : first + BLOCK_SAMPLES]).max() < 1e-8


@pytest.mark.parametrize("what", ["gap", "manual"])
@pytest.mark.parametrize(
    ("at", "kept"), [(LEAST_BLOCK_SAMPLES + 50, True), (LEAST_BLOCK_SAMPLES - 50, False)]
)
def test_a_gap_and_manual_end_a_block_which_is_let_go_where_it_is_short(what, at, kept):
    """No block reaches across; the next begins after it."""
    time = np.arange(N) + (1000 if what == "gap" else 0) * (np.arange(N) >= at)
    auto = (np.arange(N) < at) | (np.arange(N) >= at + 30) if what == "manual" else True
    blocks = blocks_of(samples_of(time, np.full(N, 50.0), 50 + noise(N), 30 + noise(N), auto))
    ends = [(b.end - START) // NS for b in blocks]
    assert any(at - 3 <= end < at for end in ends) is kept
    for block in blocks:
        inside = (block.start - START) // NS < at <= (block.end - START) // NS
        assert not inside


def test_a_missing_sample_is_filled():
    """A block's values stay equally spaced in time."""
    gone = np.isin(np.arange(N), [100, 500, 501, 900])
    block = blocks_of(QUIET.take(np.flatnonzero(~gone)))[0]
    assert (block.end - block.start) / NS == BLOCK_SAMPLES - 1


@settings(max_examples=20, deadline=None)
@given(st.lists(st.integers(1, N - 1), max_size=8))
def test_blocks_are_the_same_whatever_the_batches(cuts):
    """Bit by bit."""
    whole, pieces = blocks_of(QUIET), blocks_of(QUIET, cuts)
    assert [(b.start, b.end, b.level, b.pv.tobytes()) for b in whole] == [
        (b.start, b.end, b.level, b.pv.tobytes()) for b in pieces
    ]
