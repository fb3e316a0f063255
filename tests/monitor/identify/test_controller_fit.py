"""Gains, intervals and jumps by regression on simulated loops."""

from __future__ import annotations

import numpy as np
import pytest

from monitor.contract.loops import Loop
from monitor.identify.controller_fit import (
    Known,
    Place,
    estimate,
    explained,
    jumps,
    placed,
    trimmed,
    walk_share,
)
from monitor.identify.controller_rows import Rows, lay_out
from tests.support.controllers import Block, recorded, window_of

PI = Known(1.5, 1.5 / 80.0, 0.0, 0.0, 1.0, 1.0, derivative=False)
FREE = np.full(4, np.nan)
NOWHERE = Place(0.0, 0.0, 0.0)


def rows_of(op_noise: float = 0.0, seed: int = 0, **facts: object) -> Rows:
    sp, pv, op = recorded(Block(), noise=0.1, seed=seed, **facts)  # type: ignore[arg-type]
    rows = lay_out(
        window_of(sp, pv, op + np.random.default_rng(seed + 1000).normal(0, op_noise, len(op))),
        1.0,
        Loop(name="L"),
    )
    assert rows is not None
    return rows


def test_intervals_hold() -> None:
    """Under noise of OP that the law does not know, 95 of 100 intervals of kp and ki hold the truth."""
    held = np.zeros(2)
    for seed in range(100):
        rows = rows_of(0.1, seed)
        found = estimate(rows, PI, walk_share(rows, PI.law(rows), PI.active, FREE), NOWHERE)
        for k, truth in enumerate((PI.kp, PI.ki)):
            low, high = found.ends(k, 1.96)
            held[k] += low <= truth <= high
    assert (held >= 90).all()


def test_the_walk_is_told_from_noise() -> None:
    white = rows_of(0.1)
    assert walk_share(white, PI.law(white), PI.active, FREE) <= 1e-2
    walking = rows_of(forward=np.random.default_rng(3).normal(0.0, 0.1, 600).cumsum())
    assert walk_share(walking, PI.law(walking), PI.active, FREE) == 1.0


def test_a_feed_forward_that_jumps_is_left_out() -> None:
    forward = np.where(np.arange(600) >= 300, 7.0, 0.0)
    rows = trimmed(rows_of(0.02, forward=forward), (0.0, 1.0, 1.0, 1.0, 0.0), PI.active, 0.0)
    assert rows.fresh[300]
    assert np.count_nonzero(rows.fresh) < 5
    found = estimate(rows, PI, 1e-2, NOWHERE)
    assert found.gains[0] == pytest.approx(1.5, rel=0.02)


def test_many_jumps_are_none() -> None:
    size = np.abs(np.random.default_rng(0).standard_t(1, 400))
    assert len(jumps(size, np.ones(400, bool), 0.0, float(np.median(size)))) == 0


def test_a_place_and_what_it_explains() -> None:
    sp, pv, op = recorded(Block(pv_filter=6.0), noise=0.1)
    rows = lay_out(window_of(sp, pv, op), 1.0, Loop(name="L"))
    assert rows is not None
    place = placed(rows, PI, PI.gains, 1.0)
    assert place.filter_time == pytest.approx(6.0, abs=0.05)
    assert explained(rows, PI, PI.gains, place, 1.0) > 0.99 > explained(rows, PI, PI.gains, NOWHERE, 1.0)
