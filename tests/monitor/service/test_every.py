"""Due at the first tick, then so long after it was found due; sooner or later on request."""

from __future__ import annotations

from monitor.service.every import Every


def test_due_at_once_and_then_again():
    """A tick that comes late moves the next time on: there is no making up for it."""
    every = Every(10.0)
    assert [now for now in (0.0, 1.0, 10.0, 27.0, 30.0, 36.9, 37.0) if every.due(now)] == [
        0.0,
        10.0,
        27.0,
        37.0,
    ]


def test_first_time_later():
    every = Every(10.0, first=5.0)
    assert [every.due(now) for now in (0.0, 4.9, 5.0)] == [False, False, True]


def test_hastened_and_postponed():
    """To hasten never delays."""
    every = Every(10.0)
    assert every.due(0.0)
    every.hasten(3.0)
    assert not every.due(2.9)
    assert every.due(3.0)
    every.hasten(100.0)
    assert every.due(13.0)
    every.postpone(14.0)
    assert every.due(14.0)
