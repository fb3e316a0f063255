"""Times of any format, read by their fields; the order of day and month told by the data."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pyarrow as pa
import pytest
from hypothesis import given
from hypothesis import strategies as st

from monitor.adapters.historian.clock import DAY_FIRST, MONTH_FIRST
from monitor.adapters.historian.time_formats import (
    day_only,
    is_time_text,
    joined_texts,
    order_of_dates,
    order_of_format,
    read_text_times,
)

FORMS = {
    "%d-%b-%y %H:%M:%S": "",
    "%d-%b-%Y %I:%M:%S %p": "",
    "%b %d, %Y %I:%M:%S %p": "",
    "%m/%d/%Y %I:%M:%S %p": MONTH_FIRST,
    "%m/%d/%y %H:%M:%S": MONTH_FIRST,
    "%d/%m/%Y %H:%M:%S": DAY_FIRST,
    "%d-%m-%Y %H:%M:%S": DAY_FIRST,
    "%d.%m.%Y %H:%M:%S": "",
    "%Y-%m-%dT%H:%M:%S": "",
    "%Y/%m/%d %H:%M:%S": "",
    "%Y%m%d%H%M%S": "",
    "%H:%M:%S %d.%m.%Y": "",
    "%a %d-%b-%Y %H:%M:%S": "",
}
SECONDS = st.integers(946_684_800, 4_102_444_799)  # 2000 to 2099: years of two digits are of this century


@pytest.mark.parametrize("form", FORMS)
@given(seconds=st.lists(SECONDS, min_size=1, max_size=20))
def test_what_is_written_is_read(form: str, seconds: list[int]) -> None:
    """Any instant, in any of the formats, to the second."""
    texts = pd.to_datetime(np.array(seconds), unit="s").strftime(form)
    ns, good, aware = read_text_times(pa.array(list(texts)), FORMS[form])
    assert good.all()
    assert not aware.any()
    assert (ns == np.array(seconds) * 10**9).all()
    assert all(map(is_time_text, texts))


@given(seconds=SECONDS, minutes=st.integers(-14 * 60, 14 * 60))
def test_an_offset_is_taken_off(seconds: int, minutes: int) -> None:
    sign, size = "-" if minutes < 0 else "+", abs(minutes)
    local = pd.to_datetime(seconds + minutes * 60, unit="s").strftime("%d-%b-%Y %H:%M:%S")
    ns, good, aware = read_text_times(pa.array([f"{local} {sign}{size // 60:02d}:{size % 60:02d}"]))
    assert good.all()
    assert aware.all()
    assert ns[0] == seconds * 10**9


@given(days=st.lists(st.dates(), min_size=1, max_size=30), day_first=st.booleans())
def test_the_order_is_never_told_wrongly(days: list, day_first: bool) -> None:
    """It is the one in which the dates were written, or is asked for."""
    form, right = ("%d/%m/%Y", DAY_FIRST) if day_first else ("%m/%d/%Y", MONTH_FIRST)
    days = [d for d in days if d.year >= 1970] or [pd.Timestamp("2026-03-02").date()]
    texts = pa.array([d.strftime(form).rjust(10, "0") for d in days])
    if any(d.day > 12 for d in days):
        assert order_of_dates([texts]) == right
        return
    try:
        found = order_of_dates([texts])
    except ValueError as error:
        assert "--time-format" in str(error)  # noqa: PT017 (either is right)
    else:
        assert found == right


def test_days_in_a_row_tell_their_order() -> None:
    """Where no number is above twelve: only one of the two counts on without a gap."""
    days = pd.date_range("2026-03-02", "2026-03-09", freq="h")
    assert order_of_dates([pa.array(days.strftime("%d/%m/%Y %H:%M"))]) == DAY_FIRST
    assert order_of_dates([pa.array(days.strftime("%m/%d/%Y %H:%M"))]) == MONTH_FIRST


def test_one_line_asks_where_the_data_cannot_tell() -> None:
    with pytest.raises(
        ValueError, match=r"'02/03/2026 08:00' and all others may name .* --time-format '%d/%m/%Y"
    ):
        order_of_dates([pa.array(["02/03/2026 08:00"]), pa.array(["02/03/2026 09:00"])])
    with pytest.raises(ValueError, match="now the day, now the month first"):
        order_of_dates([pa.array(["13/01/2026", "01/13/2026"])])
    assert not order_of_dates([pa.array(["2026-01-02", "02-Jan-26"])])


def test_a_late_date_decides() -> None:
    """The whole column counts, not its beginning."""
    assert order_of_dates([pa.array(["02/03/2026"]), pa.array(["03/14/2026"])]) == MONTH_FIRST


@pytest.mark.parametrize(
    "text", ["", "48.8", "noon", "31.02.2026 08:00", "13:00 PM", "02-Foo-26 08:00", "2026-13-01"]
)
def test_what_is_no_time_is_none(text: str) -> None:
    assert not read_text_times(pa.array([text]))[1].any()


def test_missing_texts_are_no_times() -> None:
    assert read_text_times(pa.array([None, "2026-03-02"], pa.string()))[1].tolist() == [False, True]


@pytest.mark.parametrize("month", ["März", "Mrz", "Mär", "MAR", "march"])
def test_months_in_german_and_english(month: str) -> None:
    ns, good, _ = read_text_times(pa.array([f"2. {month} 2026 08:00 Uhr"]))
    assert good.all()
    assert ns[0] == pd.Timestamp("2026-03-02T08:00").value


@pytest.mark.parametrize(
    ("form", "order"),
    [
        ("%d/%m/%Y", DAY_FIRST),
        ("MM/dd/yyyy hh:mm:ss tt", MONTH_FIRST),
        ("dmy", DAY_FIRST),
        ("%m/%d/%y %H", MONTH_FIRST),
    ],
)
def test_a_format_names_its_order(form: str, order: str) -> None:
    assert order_of_format(form) == order


def test_a_format_without_order_is_refused() -> None:
    with pytest.raises(ValueError, match="--time-format: 'soon', expected"):
        order_of_format("soon")


def test_date_and_time_of_day_are_put_together() -> None:
    dates = day_only(pa.array(["2026-03-02 00:00:00", "02.03.2026"]))
    texts = joined_texts(dates, pa.array(["08:00:00", "08:00:05"]))
    assert texts.to_pylist() == ["2026-03-02 08:00:00", "02.03.2026 08:00:05"]
