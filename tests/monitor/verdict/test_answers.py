"""A loop's answers rest on the model of its row; without one, or without settings, there are none."""

from __future__ import annotations

import numpy as np
from msgspec.structs import replace

from monitor.contract.loops import Loop
from monitor.contract.records import LoopRow
from monitor.verdict.answers import answers_of
from monitor.verdict.history import LoopHistory
from monitor.verdict.in_force import InForce


def test_a_loop_without_events_has_none() -> None:
    assert answers_of(LoopHistory(InForce(Loop(name="x", kp=1.0))), LoopRow(loop="x", gain=1.0)) == ()


def test_a_loop_with_a_model_answers_by_what_its_row_suggests(watched) -> None:
    _, engine, _ = watched
    rows = [row for row in engine.rows() if row.new_kp is not None]
    row = rows[0]
    number = engine.loops.by_name[row.loop]
    setpoint, load = engine.answers(number, row)
    assert (setpoint.kind, load.kind) == ("setpoint", "load")
    assert np.isfinite(setpoint.new).all()
    other = engine.answers(number, replace(row, new_kp=row.new_kp / 2))[0]
    assert not np.array_equal(other.new[0], setpoint.new[0])
    assert engine.answers(number, replace(row, gain=None)) == ()
