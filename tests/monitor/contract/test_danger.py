"""What is to be done with a loop, and which comes first."""

from __future__ import annotations

from monitor.contract.danger import TO_RETUNE, danger, kind_of, worst_first
from monitor.contract.records import GOOD, INCONCLUSIVE, NOT_ASSESSED, RETUNE, LoopRow
from tests.monitor.report.tools import fleet


def test_danger_comes_before_speed() -> None:
    """Near instability, then a valve, then the slowest loop, then what merely cannot be judged."""
    rows = [
        LoopRow(loop="near", verdict=RETUNE, flags=("near_instability",), ci_setpoint=0.9, ms=3.0),
        LoopRow(loop="valve", verdict=INCONCLUSIVE, flags=("stiction",), ci_setpoint=0.9),
        LoopRow(loop="slow", verdict=RETUNE, ci_setpoint=0.01),
        LoopRow(loop="unsure", verdict=INCONCLUSIVE),
        LoopRow(loop="fine", verdict=GOOD, ci_setpoint=0.7),
        LoopRow(loop="none", verdict=NOT_ASSESSED, flags=("manual",)),
    ]
    assert [r.loop for r in sorted(rows[3:] + rows[:3], key=worst_first)] == [r.loop for r in rows]
    assert [r.loop for r in rows if danger(r) <= TO_RETUNE] == ["near", "valve", "slow"]


def test_each_loop_is_of_one_kind() -> None:
    kinds = ["retune", "valve", "oscillating", "retune", "unclear", "good", "manual"]
    assert [kind_of(row) for row in fleet()] == kinds
