"""What a loop's blocks show together: each sign by a loop that has it, and not by one that has not."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.signal import lfilter

from monitor.health.diagnosis import HALVED_S, MOST_MOVES, Block, Diagnosis, Signs

NS = 10**9
N = 1024


def signs(sp: Any, pv: Any, op: Any, period: float = 1.0) -> Signs:
    """What the blocks of some columns show."""
    own = Diagnosis()
    for first in range(0, len(pv), N):
        part = slice(first, first + N)
        own.add(
            Block(
                row=0,
                level=0,
                start=round(first * period * NS),
                end=round((first + N) * period * NS),
                period=period,
                sp=np.broadcast_to(np.asarray(sp, dtype=np.float64), len(pv))[part],
                pv=pv[part],
                op=op[part],
                so_far=False,
            )
        )
    return own.signs()


def noise(n: int = 2 * N, seed: int = 1) -> Any:
    return np.random.default_rng(seed).normal(size=n)


def test_a_quiet_loop_shows_nothing():
    """White noise, and OP that follows it."""
    found = signs(50.0, 50 + noise(), 30 - 0.1 * noise())
    assert not any((found.oscillating, found.too_fast, found.rests))
    assert (found.silent, found.tracks, found.gain, found.spans) == (None, None, None, ())
    assert (found.judged, found.oscillating_share) == (2.0 * N, 0.0)


def test_a_cycle_of_an_integrating_process_shows_its_gain():
    """PV is OP's integral: K = omega A_pv/A_op."""
    op = 30 + 10 * np.sin(2 * np.pi * np.arange(2 * N) / 60)
    pv = 50 + np.cumsum(0.02 * (op - 30)) + 0.01 * noise()
    found = signs(50.0, pv - np.mean(pv) + 50, op)
    assert found.oscillating
    assert found.cycle_period == pytest.approx(60, rel=0.02)
    assert found.gain is not None
    assert found.gain.gain == pytest.approx(0.02, rel=0.05)
    assert found.gain.integrating


def test_a_valve_that_is_shut_shows_as_no_answer_until_pv_answers():
    """OP ramps, the error stays; a block in which PV comes back, well after it, takes it back."""
    op = 30 + 0.02 * np.arange(2 * N) + 0.05 * noise()
    shut = signs(50.0, 45 + 0.1 * noise(), op)
    assert shut.silent is not None
    assert shut.silent.kind == "no_answer"
    assert shut.silent_time > N / 2
    open_again = np.concatenate([45 + 0.1 * noise(), 50 + 0.1 * noise(4 * N)])
    answers = np.concatenate([op, op[-1] + 0.1 * noise(4 * N)])
    assert signs(50.0, open_again, answers).silent is None


@pytest.mark.parametrize(("lag", "seen"), [(2.0, "tracks"), (0.0, None)])
def test_a_loop_that_follows_its_set_point_within_samples_tracks(lag, seen):
    """One that does not move at all does not."""
    sp = 50 + 5.0 * (np.arange(2 * N) % 400 >= 200)
    a = np.exp(-1 / lag) if lag else 1.0
    pv = 50 + lfilter([0, 1 - a], [1, -a], sp - 50) + 0.05 * noise()
    assert signs(sp, pv, 30 + sp, 10.0).tracks == seen


def test_a_frozen_pv_and_an_alternating_error_are_said():
    """PV at zero while the set point twitches; an error that turns at every sample."""
    assert signs(50 + noise(), np.zeros(2 * N), 30 + noise()).rests
    assert not signs(50.0, np.zeros(2 * N), np.full(2 * N, 30.0)).rests
    assert signs(50.0, 50 + (-1.0) ** np.arange(2 * N) + 0.1 * noise(), 30 + noise()).too_fast


def test_what_is_kept_is_bounded_and_what_is_old_counts_half():
    """A year of blocks."""
    own = Diagnosis()
    sp = 50 + 5.0 * (np.arange(N) % 100 >= 50)
    for k in range(60):
        start = round(k * HALVED_S / 20 * NS)
        own.add(
            Block(0, 0, start, start + N * NS, HALVED_S / 20 / N, sp, sp + noise(N), 30 + noise(N), False)
        )
    assert own.judged <= HALVED_S
    assert len(own.moves) == MOST_MOVES
    assert len(own.episodes[0].spans) <= 16
