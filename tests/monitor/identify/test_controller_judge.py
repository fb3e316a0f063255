"""What a recording must show before a table is contradicted or a filter believed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from monitor.contract.loops import Loop
from monitor.identify.controller_fit import Estimate, Known, Place, estimate
from monitor.identify.controller_judge import against, far, is_drawn, shown, well
from monitor.identify.controller_rows import Rows, lay_out
from tests.support.controllers import Block, recorded, window_of

PI = Known(1.5, 1.5 / 80.0, 0.0, 0.0, 1.0, 1.0, derivative=False)
NOWHERE = Place(0.0, 0.0, 0.0)


def rows_of(block: Block, **facts: float) -> Rows:
    rows = lay_out(window_of(*recorded(block, **facts)), 1.0, Loop(name="L"))
    assert rows is not None
    return rows


def found(kp: float, ki: float, sd: float = 1e-6) -> Estimate:
    gains = np.array([kp, ki, 0.0, 0.0])
    return Estimate(gains, sd * gains[:3], gains[:3], NOWHERE, 500)


@pytest.mark.parametrize("shift", [-1.0, -0.5, 0.0, 0.5, 1.0])
def test_how_a_block_integrates_is_nothing_against_a_table(shift: float) -> None:
    rows = rows_of(Block(), noise=0.1)
    assert not against(PI, found(PI.kp + shift * PI.ki, PI.ki), rows)
    assert against(PI, found(PI.kp * 1.2, PI.ki), rows)
    assert against(PI, found(PI.kp, PI.ki * 1.2), rows)


def test_what_is_not_known_is_nothing_against_a_table() -> None:
    rows = rows_of(Block(), noise=0.1)
    assert not against(PI, found(PI.kp * 1.2, PI.ki * 1.2, sd=0.1), rows)


def test_far() -> None:
    assert not far(PI, found(PI.kp * 1.1, PI.ki * 1.2))
    assert far(PI, found(PI.kp * 1.4, PI.ki))
    assert far(PI, found(PI.kp, PI.ki * 2.2))


def test_a_controller_that_changes_halfway_is_not_shown() -> None:
    one, other = rows_of(Block(kp=3.0), noise=0.1), rows_of(Block(kp=0.8), noise=0.1)
    both = Rows(
        *(
            np.concatenate([getattr(one, n), getattr(other, n)])
            for n in ("time", "sp", "pv", "op", "use", "fresh")
        ),
        period=1.0,
        quantum=0.0,
        before=128,
    )
    both = replace(both, time=np.arange(len(both), dtype=float))
    assert shown(one, PI, estimate(one, PI, 1.0, NOWHERE), 1.0)
    assert not shown(both, PI, estimate(both, PI, 1.0, NOWHERE), 1.0)


def test_straight_lines_are_drawn() -> None:
    rows = rows_of(Block(), noise=0.1)
    kept = np.arange(0, len(rows), 6)
    assert not is_drawn(rows)
    assert is_drawn(replace(rows, op=np.interp(np.arange(len(rows)), kept, rows.op[kept])))


def test_a_filter_is_believed_where_it_leaves_nothing() -> None:
    rows = rows_of(Block(pv_filter=6.0), noise=0.1)
    assert well(rows, PI, PI.gains, Place(6.0, 0.0, 0.0))
    assert not well(rows, PI, PI.gains, Place(1.0, 0.0, 0.0))
    unfiltered = rows_of(Block(), noise=0.1)
    assert not well(unfiltered, PI, PI.gains, NOWHERE)
