"""Times: units of numbers, zones, hours that are missing or come twice."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from monitor.adapters.historian.clock import clock_of_numbers, numbers_to_ns, to_utc, zone_of
from monitor.adapters.historian.merge import Span
from monitor.adapters.historian.rows import Tally, UnusableError
from tests.monitor.adapters.historian.tools import (
    SECOND,
    START,
    all_of,
    equal,
    frame,
    samples_of,
    sources,
    write,
)


@pytest.mark.parametrize(("unit", "scale"), [("s", 1.0), ("ms", 1e3), ("us", 1e6), ("ns", 1e9)])
def test_unit_of_numeric_times_by_range(unit: str, scale: float) -> None:
    assert clock_of_numbers(np.array([1.7e9, 1.7e9 + 60]) * scale).unit == unit
    assert clock_of_numbers(np.array([3e9, 3e9 + 1]) * scale).unit == unit  # 2065


def test_seconds_from_a_start_and_spreadsheet_days() -> None:
    relative = clock_of_numbers(np.arange(1000.0))
    assert (relative.unit, relative.epoch) == ("s", False)
    assert clock_of_numbers(45_000 + np.arange(100) / 86_400).unit == "excel"
    assert clock_of_numbers(np.arange(40_000.0, 50_000.0)).unit == "s"
    assert clock_of_numbers(45_000 + np.arange(100) / 86_400, "s").unit == "s"


@pytest.mark.parametrize(
    "values", [[45_000.0, 45_000.1, 45_000.2], [45_000.0], [1.7e9, 1.7e12], [1e10, 1e10 + 1]]
)
def test_ambiguous_times_name_the_option(values: list[float]) -> None:
    with pytest.raises(ValueError, match="--time-unit"):
        clock_of_numbers(np.array(values))


@pytest.mark.parametrize("year", [1995, 2039, 2150])
def test_years_far_from_today(tmp_path: Path, year: int) -> None:
    data = frame()
    data["time"] += np.datetime64(f"{year}-03-01", "ns").astype(np.int64) - START
    for suffix in (".csv", ".parquet"):
        equal(all_of(write(data, tmp_path / f"d{suffix}")), samples_of(data))


def test_float_seconds_are_rounded_to_microseconds() -> None:
    t = np.array([1.7e9 + 0.1, 1.7e9 + 0.25])
    ns, good = numbers_to_ns(t, clock_of_numbers(t))
    assert ns.tolist() == [1_700_000_000_100_000_000, 1_700_000_000_250_000_000]
    assert good.all()


def test_integer_nanoseconds_keep_every_digit(tmp_path: Path) -> None:
    data = frame()
    data["time"] += np.arange(len(data)) % 7
    for suffix in (".csv", ".parquet"):
        equal(all_of(write(data, tmp_path / f"d{suffix}", "ns")), samples_of(data))


def test_naive_times_are_read_in_the_zone(tmp_path: Path) -> None:
    data = frame()
    path = write(data, tmp_path / "d.csv", "naive")
    (source,) = sources(path)
    assert source.clock.naive
    berlin = all_of(path, span=Span(zone=zone_of("Europe/Berlin")))
    equal(berlin, samples_of(data.assign(time=data["time"] - 3600 * SECOND)))
    aware = write(data, tmp_path / "e.csv", "text")
    equal(all_of(aware, span=Span(zone=zone_of("Europe/Berlin"))), samples_of(data))


BERLIN = zone_of("Europe/Berlin")
AUTUMN = np.datetime64("2026-10-25T00:00:00", "ns").astype(np.int64)  # UTC; the hour 02:00 local comes twice


@pytest.mark.parametrize("order", ["interleaved", "by loop", "reversed"])
def test_repeated_hour_is_told_apart_by_order(tmp_path: Path, order: str) -> None:
    """Three hours every ten minutes, across the change: no time goes back, none is lost."""
    n = 18
    data = frame(n).assign(time=np.repeat(AUTUMN - 1800 * SECOND + 600 * SECOND * np.arange(n), 2))
    local = pd.to_datetime(data["time"], utc=True).dt.tz_convert("Europe/Berlin").dt.tz_localize(None)
    cells = data.assign(time=local.dt.strftime("%Y-%m-%d %H:%M:%S"))
    assert local.duplicated(keep=False).sum() > n
    if order == "by loop":
        cells = cells.sort_values("loop", kind="stable")
    if order == "reversed":
        cells = cells[::-1]
    cells.to_csv(tmp_path / "d.csv", index=False)
    tally = Tally()
    equal(all_of(tmp_path / "d.csv", span=Span(zone=BERLIN), tally=tally), samples_of(data))
    assert tally.duplicate == 0


def test_hour_seen_once_belongs_to_the_side_it_continues() -> None:
    minute = 60 * SECOND
    first = np.datetime64("2026-10-25T02:00", "ns").astype(np.int64) + minute * np.arange(60)
    code = np.zeros(120, np.int32)
    before, after = first - 60 * minute, first + 60 * minute
    assert BERLIN is not None
    went_on = to_utc(np.concatenate([before, first]), code, BERLIN)
    assert (np.diff(went_on) == minute).all()
    began = to_utc(np.concatenate([first, after]), code, BERLIN)
    assert (np.diff(began) == minute).all()


def test_missing_hour_is_an_error_with_its_line(tmp_path: Path) -> None:
    cells = frame(quality=False).assign(time="2026-03-29 01:59:00")
    cells.loc[6, "time"] = "2026-03-29 02:30:00"
    cells.to_csv(tmp_path / "d.csv", index=False)
    with pytest.raises(UnusableError) as caught:
        all_of(tmp_path / "d.csv", span=Span(zone=BERLIN))
    assert str(caught.value) == "d.csv:8: time: 2026-03-29 02:30:00 does not exist in Europe/Berlin"


def test_unknown_zone_is_refused() -> None:
    with pytest.raises(ValueError, match="--tz: 'Mars/Olympus'"):
        zone_of("Mars/Olympus")


@pytest.mark.parametrize(
    ("form", "first"),
    [
        ("%d/%m/%Y %H:%M:%S", "2026-10-25"),
        ("%m/%d/%Y %H:%M", "2026-10-25"),
        ("%d/%m/%Y %H:%M:%S", "2026-03-31"),
    ],
)
@pytest.mark.parametrize("zone", ["Europe/Berlin", "UTC"])
def test_dates_with_slashes_where_they_have_one_reading(
    tmp_path: Path, form: str, first: str, zone: str
) -> None:
    """A number above twelve tells the day; the day after is read in the same order, also where it could be a month."""
    start = np.datetime64(f"{first}T12:00:00", "ns").astype(np.int64)
    data = frame(auto=False, quality=False)
    data["time"] = start + (data["time"] - START) * 60 * 60
    local = pd.to_datetime(data["time"]).dt.tz_localize("UTC").dt.tz_convert(zone)
    path = tmp_path / "d.csv"
    data.assign(time=local.dt.strftime(form)).to_csv(path, index=False)
    equal(all_of(path, span=Span(zone=zone_of(zone))), samples_of(data))


@pytest.mark.parametrize("form", ["%d/%m/%Y %H:%M:%S", "%m/%d/%Y %H:%M:%S"])
def test_dates_with_slashes_that_may_be_either_are_refused(tmp_path: Path, form: str) -> None:
    text = pd.to_datetime(frame()["time"]).dt.strftime(form)  # 1 March 2026
    path = tmp_path / "d.csv"
    frame().assign(time=text).to_csv(path, index=False)
    with pytest.raises(
        UnusableError, match="may name the day or the month first; say which by --time-format"
    ):
        all_of(path)
