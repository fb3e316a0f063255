"""Rows of all loops: worst first."""

from __future__ import annotations

from monitor.contract.danger import danger, worst_first


def test_rows_come_worst_first(watched):
    """By danger: near instability, valve and other faults, then `retune` and the rest; each loop once."""
    specs, engine, _ = watched
    rows = engine.rows()
    assert sorted(r.loop for r in rows) == sorted(s.name for s in specs)
    places = [danger(r) for r in rows]
    assert places == sorted(places)
    assert [worst_first(r) for r in rows] == sorted(worst_first(r) for r in rows)
