"""When a loop is stale, and what its row says of it."""

from __future__ import annotations

import numpy as np
import pytest

from monitor.contract.records import GOOD, LoopRow
from monitor.verdict.stale import LIVE, STALE, LastSample, is_stale, mark_stale, patience_of_export

HOUR = 3_600_000_000_000


@pytest.mark.parametrize(
    ("silence", "period", "stale"),
    [(10.0, 1.0, False), (10.1, 1.0, True), (90.0, 30.0, False), (90.1, 30.0, True), (600.0, 0.0, False)],
)
def test_three_periods_and_ten_seconds(silence, period, stale):
    """Both; ten minutes while the period is not known."""
    assert bool(is_stale(silence, period, LIVE)) is stale
    assert is_stale(np.array([silence, 1e9]), np.array([period, 0.0]), LIVE).tolist() == [stale, True]


@pytest.mark.parametrize(("hours", "least"), [(10, 3600.0), (1000, 36_000.0)])
def test_an_export_s_end(hours, least):
    """An hour, or a hundredth of the whole time; a slower loop gets its three periods."""
    patience = patience_of_export(0, hours * HOUR)
    assert not is_stale(least, 1.0, patience)
    assert is_stale(least + 1.0, 1.0, patience)
    assert is_stale(least + 1.0, 0.0, patience)
    assert not is_stale(2.0 * least, least, patience)


def last(good: int = 100, value: int = 0, quality: int = 0, run: int = 0) -> LastSample:
    return LastSample(time=0, period=1.0, good=good, bad_value=value, bad_quality=quality, bad_run=run)


def test_a_row_that_is_not_stale_stays():
    row = LoopRow(loop="L", verdict=GOOD)
    assert mark_stale(row, last(), False) is row


def test_since_when_and_what_came():
    """Behind what the events say, before what explains that there are none."""
    row = LoopRow(loop="L", verdict=GOOD, reason="speed only", flags=("manual",))
    found = mark_stale(row, last(run=7), True)
    assert found.reason == "speed only; nothing but bad samples (7) since second 0"
    assert found.flags == ("manual", STALE)
    assert (
        mark_stale(LoopRow(loop="L", reason="idle"), last(), True).reason == "no sample since second 0; idle"
    )


@pytest.mark.parametrize(
    ("counts", "said"),
    [
        ((0, 0), "no data: no sample was seen"),
        ((0, 3), "no data: all 3 samples were bad (quality)"),
        ((2, 1), "no data: all 3 samples were bad (most: no number, or out of range)"),
    ],
)
def test_never_a_good_sample(counts, said):
    """Why, in place of a guess by the loop's health; no flag: nothing has ended."""
    row = mark_stale(LoopRow(loop="L", reason="no good sample was seen"), last(0, *counts), True)
    assert (row.reason, row.flags) == (said, ())
