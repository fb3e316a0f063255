"""Rows of all loops: worst first."""

from __future__ import annotations

from monitor.contract.records import GOOD, INCONCLUSIVE, NOT_ASSESSED, RETUNE
from monitor.engine import worst_first


def test_rows_come_worst_first(watched):
    """`retune` first, then `inconclusive`, `good`, `not_assessed`; each loop once."""
    specs, engine, _ = watched
    rows = engine.rows()
    assert sorted(r.loop for r in rows) == sorted(s.name for s in specs)
    order = [RETUNE, INCONCLUSIVE, GOOD, NOT_ASSESSED]
    places = [order.index(r.verdict) for r in rows]
    assert places == sorted(places)
    assert [worst_first(r) for r in rows] == sorted(worst_first(r) for r in rows)
