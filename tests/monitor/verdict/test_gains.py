"""With what differing gains go: a side of OP, a level of PV, or nothing that was seen."""

from __future__ import annotations

from dataclasses import replace

import pytest

from monitor.assess.event import Finding
from monitor.contract.records import INCONCLUSIVE, SETPOINT, Assessment
from monitor.verdict.gains import goes_with
from monitor.verdict.joint import joint_of
from tests.support.fits import make_fit


def event(gain: float, op_level: float, pv_level: float = 50.0) -> Finding:
    record = Assessment(
        loop="L", id="", event=1, kind=SETPOINT, start=0, end=0, state="settled", amplitude=1.0,
        verdict=INCONCLUSIVE, reason="",
    )  # fmt: skip
    finding = Finding(
        record, make_fit(gain=gain), usable=True, wide=False, is_event=True, noise=0.01, period=1.0
    )
    return replace(finding, levels=((op_level - 2, op_level + 2), (pv_level - 1, pv_level + 1)))


def test_a_split_range_is_named_by_the_side_of_op():
    """Cools with four times the gain below 50 %: the value between the nearest events of both sides."""
    said = goes_with([event(0.02, 70), event(0.08, 30), event(0.021, 56), event(0.079, 40)])
    assert said.startswith("the gain is 0.079 with OP below 48 and 0.02 above")


def test_a_vessel_that_is_wider_in_the_middle_is_named_by_the_level_of_pv():
    """OP rests at the same value whatever the level."""
    events = [event(0.0167, 50, 10), event(0.01, 49, 50), event(0.0165, 51, 12), event(0.0102, 52, 60)]
    said = goes_with(events)
    assert "with PV below 31" in said
    joint, why = joint_of(events)
    assert joint is not None
    assert said in why


def test_an_event_that_crosses_the_value_shows_something_between():
    """One large step from the middle to the bottom."""
    crossing = replace(event(0.012, 50), levels=((48.0, 52.0), (11.0, 50.0)))
    events = [
        event(0.0167, 50, 10),
        event(0.01, 49, 50),
        crossing,
        event(0.0165, 51, 12),
        event(0.0102, 52, 60),
    ]
    assert "is 0.017 with PV below 21.2 and 0.01 above" in goes_with(events)


@pytest.mark.parametrize("gains", [[0.02, 0.08, 0.02, 0.08], [0.02, 0.08], [0.02, 0.0201, 0.0199]])
def test_gains_that_go_to_and_fro_two_events_and_equal_ones_are_not(gains):
    """By turns along OP; two that anything may have come between; and no difference at all."""
    assert not goes_with([event(gain, 10.0 * k) for k, gain in enumerate(gains)])
