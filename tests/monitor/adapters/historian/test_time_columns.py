"""The column of times."""

from __future__ import annotations

import pytest

from monitor.adapters.historian.mapping import ExportMapping
from monitor.adapters.historian.time_columns import own_times, time_columns
from tests.monitor.adapters.historian.test_recognise import TIME, TWO, look


def test_one_column_or_date_and_time_of_day() -> None:
    assert time_columns(look({"x": TWO, "Zeit": TIME})) == ("Zeit", "")
    assert time_columns(look({"Date": ["14.03.2026"] * 2, "Clock": ["08:00", "08:01"], "x": TWO})) == (
        "Date",
        "Clock",
    )
    assert time_columns(look({"epoch": TWO, "x": TWO})) == ("epoch", "")
    assert time_columns(look({"server time": TIME, "source time": TIME})) == ("source time", "")
    assert time_columns(look({"a": TIME, "b": TIME}, given=ExportMapping(time=("b",)))) == ("b", "")


def test_none() -> None:
    with pytest.raises(ValueError, match="no column of times among x"):
        time_columns(look({"x": TWO}))


def test_a_time_before_each_tag() -> None:
    columns = {"T": TIME, "A.SP": TWO, "T (2)": TIME, "A.PV": TWO, "T (3)": TIME, "A.OP": TWO}
    assert own_times(look(columns), ["T (2)", "T (3)"]) == {"A.SP": "T", "A.PV": "T (2)", "A.OP": "T (3)"}
    assert own_times(look({"T": TIME, "A.SP": TWO, "A.PV": TWO, "A.OP": TWO}), []) == {}
