"""One controller or two: compared and combined."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from monitor.identify.controller_seen import (
    AS_DECLARED,
    BESIDE,
    CONTRADICTED,
    FOUND,
    NOT_LINEAR,
    UNRESOLVED,
    Controller,
    Interval,
    combined,
    differ,
    together,
)
from tuners.settings import Settings


def seen(kp: float, ti: float, half: float = 0.02, said: str = FOUND) -> Controller:
    spread = 1 + half
    ends = [Interval(v, v / spread, v * spread) for v in (kp, ti)]
    return Controller(said, Settings(kp, ti), *ends, Interval(0.0, 0.0, 0.0), 0.99)


def test_a_change_is_said_in_words_and_none_where_intervals_meet() -> None:
    assert differ(seen(2.0, 80.0), seen(3.5, 80.0)) == "kp 2 to 3.5"
    assert differ(seen(2.0, 80.0), seen(2.05, 80.0)) == ""
    assert differ(seen(2.0, 80.0, 0.5), seen(3.5, 80.0, 0.5)) == ""
    assert differ(seen(2.0, 80.0), seen(2.0, math.inf)) == "ti 80 to inf s"


def test_the_delay_counts_half_of_a_longer_scan() -> None:
    found = Controller(BESIDE, pv_filter=2.0, op_delay=1.0, scan=5.0, period=1.0)
    assert found.delay == 5.0
    assert Controller(AS_DECLARED, op_delay=-2.0, period=1.0).delay == 0.0


def test_settings_come_in_the_loops_form() -> None:
    found = Controller(FOUND, Settings(2.5, 25.0, 4.0))
    assert found.settings_in("series") == Settings(2.5, 25.0, 4.0).to("series")
    assert Controller(FOUND, Settings(2.5, 10.0, 4.0)).settings_in("series") is None
    assert Controller(UNRESOLVED).settings_in("series") is None


def test_windows_together() -> None:
    assert combined([]) is None
    both = combined([seen(2.0, 80.0), seen(2.02, 81.0), Controller(UNRESOLVED)])
    assert both is not None
    assert both.said == FOUND
    assert both.settings is not None
    assert both.settings.kp == pytest.approx(2.01, rel=1e-3)
    wrong = combined(
        [
            seen(2.0, 80.0, said=CONTRADICTED),
            seen(2.0, 80.0, said=CONTRADICTED),
            seen(2, 80, said=AS_DECLARED),
        ]
    )
    assert wrong is not None
    assert wrong.said == CONTRADICTED


def test_a_filter_seen_once_is_not_voted_down_by_windows_that_show_less() -> None:
    many = [seen(2.0, 80.0, said=AS_DECLARED)] * 3 + [seen(2.0, 80.0, said=BESIDE)]
    found = combined(many)
    assert found is not None
    assert found.said == BESIDE


def test_a_law_that_shows_in_few_windows_is_not_voted_down() -> None:
    many = [seen(2.0, 80.0, said=AS_DECLARED)] * 5
    weights = replace(seen(2.0, 80.0, said=CONTRADICTED), setpoint_only=True)
    for other, said in ((seen(9.0, 9.0, said=NOT_LINEAR), NOT_LINEAR), (weights, CONTRADICTED)):
        found = combined([*many, other])
        assert found is not None
        assert found.said == said


@given(st.lists(st.tuples(st.floats(0.1, 10), st.floats(0.001, 1)), min_size=1, max_size=6))
def test_together_lies_among_its_parts(parts: list[tuple[float, float]]) -> None:
    intervals = [Interval(v, v - h, v + h) for v, h in parts]
    mean = together(intervals)
    assert min(v for v, _ in parts) - 1e-9 <= mean.value <= max(v for v, _ in parts) + 1e-9
    assert mean.low <= mean.value <= mean.high
