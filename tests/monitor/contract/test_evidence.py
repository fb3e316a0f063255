"""Parts of a trend are joined."""

from __future__ import annotations

import numpy as np

from monitor.contract.evidence import merge
from monitor.contract.times import nanoseconds
from monitor.wire.arrow import decode_trend
from tests.support.fake_monitor import arrow


def test_merge_and_times() -> None:
    """Parts of a trend are joined in the order of time; a time without zone is UTC."""
    payloads = [arrow({"time": np.array(t), "sp": x, "pv": x, "op": x}, {"loop": "L"})
                for t, x in (([30, 40], np.array([3.0, 4.0])), ([10, 20], np.array([1.0, 2.0])))]  # fmt: skip
    joined = merge([decode_trend(p) for p in payloads])
    assert joined.time.tolist() == [10, 20, 30, 40]
    assert joined.pv.tolist() == [1.0, 2.0, 3.0, 4.0]
    assert (
        nanoseconds("1970-01-01T00:00:01.000001Z")
        == nanoseconds("1970-01-01T00:00:01.000001")
        == 1_000_001_000
    )
    assert nanoseconds("yesterday") is nanoseconds(7) is None
