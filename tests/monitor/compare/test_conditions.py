"""What differs between two periods beside the loop, and whether the process is another one."""

from __future__ import annotations

from monitor.compare.conditions import conditions_of, process_change

from .tools import events, row, spells

DAY = (spells(0.1), spells(0.1))


def test_alike_periods_have_nothing_to_say() -> None:
    assert conditions_of((row(), row()), (events([0.5] * 6), events([0.9] * 7)), DAY) == []


def test_noise() -> None:
    (found,) = conditions_of((row(), row(noise=0.05)), ([], []), DAY)
    assert found.words == "noise 0.02 → 0.05 [PV]"
    assert found.harder
    assert not conditions_of((row(noise=0.05), row()), ([], []), DAY)[0].harder


def test_the_set_point_is_moved_more() -> None:
    few, many = events([0.01] * 2, amplitude=15.0), events([0.01] * 8, amplitude=15.0)
    (found,) = conditions_of((row(), row()), (few, many), DAY)
    assert found.words == "set point moved 30 → 120 [PV] a day"
    assert found.harder
    assert (
        conditions_of((row(), row()), (events([9.0] * 2), events([9.0] * 8)), DAY) == []
    )  # no part of the error
    assert conditions_of((row(), row()), (few, many), ([], DAY[1])) == []  # not known how long


def test_upsets_come_more_often() -> None:
    (found,) = conditions_of(
        (row(), row()), (events([0.5] * 2, kind="load"), events([0.5] * 24, kind="load")), DAY
    )
    assert found.words == "upsets 2 → 24 a day"
    assert conditions_of((row(), row()), ([], events([0.5] * 4, kind="load")), DAY) == []  # by chance


def test_loads_are_larger() -> None:
    small, large = (events([0.5] * 6, kind="load", amplitude=a) for a in (2.0, -6.0))
    (found,) = conditions_of((row(), row()), (small, large), DAY)
    assert found.words == "load steps 3 times as large [OP]"


def test_the_process_has_changed_where_the_intervals_do_not_meet() -> None:
    def model(gain: float) -> dict[str, object]:
        return {"process": "integrating", "gain": gain, "gain_lo": 0.9 * gain, "gain_hi": 1.1 * gain}

    assert process_change(row(**model(0.1)), row(**model(0.11))) == ""
    assert process_change(row(**model(0.1)), row()) == ""
    assert process_change(row(**model(0.1)), row(**model(0.2))) == "the process has changed (gain 0.1 → 0.2)"
