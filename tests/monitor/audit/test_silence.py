"""Which loops of an export are stale: against where most of the others end, and since when in words."""

from __future__ import annotations

import pytest

from monitor.audit.silence import Silence, end_of_most
from monitor.audit.tasks import Part
from monitor.contract.records import LoopRow
from monitor.verdict.stale import LastSample

HOUR = 3_600_000_000_000
DAY = 1_767_225_600_000_000_000
"""2026-01-01 [ns]."""


def parts(*ends: float) -> list[Part]:
    """One part for each loop, which ends after so many hours."""
    out = []
    for k, end in enumerate(ends):
        last = LastSample(
            time=DAY + round(end * HOUR), period=1.0, good=100, bad_value=0, bad_quality=0, bad_run=0
        )
        out.append(Part(rows=[LoopRow(loop=f"L{k}")], last={f"L{k}": last}))
    return out


@pytest.mark.parametrize(
    ("ends", "stale"),
    [
        ((10, 10, 10), ()),
        ((8, 10, 10), (0,)),
        ((9.5, 10, 10), ()),
        ((10, 10, 10, 40), ()),  # one goes on alone, or has a wrong clock
        ((7, 10), (0,)),
        ((10,), ()),
    ],
)
def test_against_where_most_loops_end(ends, stale):
    given = parts(*ends)
    silence = Silence(DAY, end_of_most(p.last for p in given))
    rows = [row for part in given for row in silence.rows(part)]
    assert tuple(k for k, row in enumerate(rows) if "stale" in row.flags) == stale


def test_loops_without_a_good_sample_say_nothing_of_the_end():
    none = LastSample(time=0, period=0.0, good=0, bad_value=3, bad_quality=0, bad_run=3)
    assert end_of_most([{"L": none}]) == 0
    assert end_of_most([{"L": none}, *(p.last for p in parts(10))]) == DAY + 10 * HOUR
