"""Times on the wire, there and back."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from monitor.contract.times import iso, time_of


@given(st.integers(0, 2**31))
def test_iso_and_back(seconds):
    """The time on the wire is the instant, to the microsecond, before and after 2038."""
    ns = seconds * 2 * 10**9 + 123_456_000
    assert time_of(iso(ns), 0) == ns
    assert abs(time_of(ns / 1e9, 0) - ns) <= 1000
