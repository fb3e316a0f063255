"""Rows of all loops: worst first."""

from __future__ import annotations

from monitor.contract.records import GOOD, INCONCLUSIVE, NOT_ASSESSED, RETUNE, LoopRow
from monitor.engine import worst_first
from monitor.verdict.row import danger


def test_rows_come_worst_first(watched):
    """By danger: near instability, valve and other faults, then `retune` and the rest; each loop once."""
    specs, engine, _ = watched
    rows = engine.rows()
    assert sorted(r.loop for r in rows) == sorted(s.name for s in specs)
    places = [danger(r) for r in rows]
    assert places == sorted(places)
    assert [worst_first(r) for r in rows] == sorted(worst_first(r) for r in rows)


def test_danger_comes_before_speed():
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
