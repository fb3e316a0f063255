"""Blocks that wait, and what they show: in order of time, each once, and so far where a block goes on."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from monitor.health.diagnoses import Diagnoses
from monitor.health.diagnosis import NO_SIGNS, Block

NS = 10**9
N = 1024


def block(start: int, swing: float, row: int = 0, **facts: Any) -> Block:
    """A block whose error swings with a period of 50 s, or is noise."""
    t = np.arange(N)
    pv = 50 + swing * np.sin(2 * np.pi * t / 50) + 0.1 * np.random.default_rng(start).normal(size=N)
    own = Block(
        row=row, level=0, start=start * NS, end=(start + N - 1) * NS, period=1.0, sp=np.full(N, 50.0), pv=pv,
        op=30 - pv, so_far=False,
    )  # fmt: skip
    return replace(own, **facts)


def test_a_loop_is_judged_by_its_blocks_up_to_then():
    """What comes later waits; another loop's blocks are its own."""
    many = Diagnoses()
    many.wait([block(0, 1.0), block(N, 0.0), block(0, 0.0, row=7)])
    assert many.signs(0) == NO_SIGNS
    assert many.look(0, N * NS).oscillating_share > 0.9
    assert set(many.waiting) == {0, 7}
    assert 0.4 < many.look(0).oscillating_share < 0.6
    assert many.look(7).oscillating_share == 0.0
    assert not many.waiting


def test_a_block_that_goes_on_is_looked_at_and_not_kept():
    """It comes again when it is full; where it is full already, it is not looked at twice."""
    many = Diagnoses()
    many.wait([block(0, 1.0, so_far=True)])
    assert many.look(0, N * NS).oscillating_share > 0.9
    assert many.signs(0).oscillating_share is None
    many.wait([block(0, 1.0, so_far=True), block(0, 1.0), block(N, 0.0, so_far=True)])
    assert many.look(0, 2 * N * NS).judged == N  # of a later block only the whole


def test_no_more_loops_wait_than_there_is_room_for():
    """A loop that waits already may wait for more."""
    many = Diagnoses(most=2)
    many.wait([block(0, 0.0, row=row) for row in (1, 2, 3, 1)])
    assert {row: len(blocks) for row, blocks in many.waiting.items()} == {1: 2, 2: 1}


def test_a_loop_is_forgotten():
    """Its blocks and what they showed."""
    many = Diagnoses()
    many.wait([block(0, 1.0), block(N, 1.0)])
    many.look(0, N * NS)
    many.forget(0)
    assert many.look(0) == NO_SIGNS
