"""A comparison counts and hands out its loops."""

from __future__ import annotations

from monitor.contract.changes import BETTER, MISSING, NEW, OUTCOMES, SAME, UNKNOWN, Comparison, LoopChange


def test_loops_by_outcome() -> None:
    outcomes = [SAME, NEW, BETTER, MISSING]
    loops = tuple(LoopChange(f"L{k}", o, UNKNOWN, "", "") for k, o in enumerate(outcomes))
    found = Comparison({}, {}, loops, {o: outcomes.count(o) for o in OUTCOMES}, (), ())
    assert found.shared == 2
    assert [c.loop for c in found.of(MISSING, SAME)] == ["L0", "L3"]
