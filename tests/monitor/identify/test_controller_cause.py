"""The likely mistake in a loop table, by name."""

from __future__ import annotations

import pytest

from monitor.contract.loops import Loop
from monitor.identify.controller_cause import cause_of, same, short_number
from tuners.settings import Settings

SLACK = (1.05, 1.05, 1.05)


@pytest.mark.parametrize(
    ("loop", "seen", "said"),
    [
        (Loop(name="L", kp=2.0, ti=2.0), Settings(2.0, 120.0), "Ti = 120 s, the table says 2: minutes?"),
        (Loop(name="L", kp=2.0, ti=0.5), Settings(2.0, 119.0), "repeats a minute?"),
        (Loop(name="L", kp=2.0, ti=7200.0), Settings(2.0, 120.0), "seconds for minutes?"),
        (Loop(name="L", kp=2.0, ti=90.0), Settings(-2.0, 90.0), "the sign"),
        (Loop(name="L", kp=2.0), Settings(2.0, 90.0), "Ti = 90 s, the table says none"),
        (Loop(name="L", kp=40.0, ti=90.0), Settings(2.5, 90.0), "a proportional band?"),
        (Loop(name="L", kp=1.0, ti=90.0), Settings(2.55, 90.0), "a byte"),
        (
            Loop(name="L", kp=1.0, ti=90.0, td=2.0),
            Settings(1.0, 90.0, 120.0),
            "Td = 120 s, the table says 2: minutes?",
        ),
    ],
)
def test_causes(loop: Loop, seen: Settings, said: str) -> None:
    assert said in cause_of(loop, seen, SLACK)


def test_a_form_is_named_before_single_numbers() -> None:
    series = Settings(2.0, 60.0, 12.0, 1.2, "series")
    loop = Loop(name="L", kp=2.0, ti=60.0, td=12.0, tf=1.2)
    assert "series form" in cause_of(loop, series.to("standard"), SLACK)


def test_same() -> None:
    assert same(1.0, 1.04, 1.05)
    assert not same(1.0, -1.0, 1.05)
    assert same(float("inf"), float("inf"), 1.05)
    assert short_number(123.456) == "123"
