"""Times on the wire, there and back."""

from __future__ import annotations

from zoneinfo import ZoneInfo

import pytest
from hypothesis import given
from hypothesis import strategies as st

from monitor.contract.times import LATEST_NS, given_time, instant, iso, nanoseconds, time_of


@given(st.integers(0, 2**31))
def test_iso_and_back(seconds):
    """The time on the wire is the instant, to the microsecond, before and after 2038."""
    ns = seconds * 2 * 10**9 + 123_456_000
    assert time_of(iso(ns), 0) == ns
    assert abs(time_of(ns / 1e9, 0) - ns) <= 1000


@pytest.mark.parametrize(
    ("text", "seconds"),
    [
        ("1970-01-01T00:00:01.5Z", 1.5),
        ("1969-12-31T23:59:58.5Z", -1.5),
        ("1969-12-31T23:59:58.5", -1.5),
        ("1970-01-01T01:00:00+01:00", 0.0),
        ("1901-01-01T00:00:00.000001Z", -2_177_452_799.999999),
    ],
)
def test_every_reader_of_a_time_reads_the_same(text, seconds):
    """Before 1970 too, where a fraction cut off would be a second late."""
    ns = round(seconds * 1e6) * 1000
    assert instant(text) == given_time(text) == nanoseconds(text) == time_of(text, 0) == ns


def test_a_time_without_zone_is_read_in_the_one_that_is_named():
    berlin = ZoneInfo("Europe/Berlin")
    assert given_time("2026-07-01T12:00", berlin) == instant("2026-07-01T10:00Z")
    assert given_time("2026-07-01T12:00+00:00", berlin) == instant("2026-07-01T12:00Z")


def test_a_given_time_that_nanoseconds_cannot_hold_is_the_last_that_they_can():
    assert given_time("9999-01-01") == given_time("1e300") == LATEST_NS
    assert given_time("0001-01-01") == -LATEST_NS
    assert given_time(" 2.5 ") == 2_500_000_000


@pytest.mark.parametrize("text", ["nan", "inf", "", "yesterday", "2026-13-01"])
def test_what_is_no_time(text):
    with pytest.raises(ValueError, match=r"."):
        given_time(text)
    assert nanoseconds(text) is None
    assert nanoseconds(7) is None
