"""Records to JSON: no NaN, times with Z."""

from __future__ import annotations

import json
import math
from typing import Any

import numpy as np
import pytest

from monitor.contract.records import Event, LoopRow, Suggestion
from monitor.wire.encode import encode_record, to_json
from tests.monitor.wire.tools import NAN, NOW


def test_records_hold_no_nan_and_times_with_z():
    """Every record: schema, null for NaN and infinity, ISO times with Z."""

    def strict(data: bytes) -> Any:
        return json.loads(data, parse_constant=pytest.fail)

    event = Event(id="i", loop="<b>", kind="setpoint", state="open", start=NOW, end=None, amplitude=NAN)
    row = LoopRow(loop="x", new_ti=math.inf, ms=NAN, flags=("manual",))
    said = strict(encode_record(event))
    assert said == {
        "schema": 1, "id": "i", "loop": "<b>", "kind": "setpoint", "state": "open",
        "start": "2026-11-22T10:00:00.000000Z",
        "end": None, "amplitude": None,
    }  # fmt: skip
    said = strict(encode_record(Suggestion(row=row, evidence=("a", "b"))))
    assert (said["new_ti"], said["ms"], said["flags"], said["evidence"]) == (
        None,
        None,
        ["manual"],
        ["a", "b"],
    )
    said = strict(to_json({"a": {"b": NAN}, "c": [NAN, {"d": math.inf}]}))
    assert said == {"schema": 1, "a": {"b": None}, "c": [None, {"d": None}]}


def test_numpys_numbers_are_numbers():
    """A figure that came out of NumPy encodes like any other, and its NaN is null."""
    row = LoopRow(loop="L", noise=np.float64(0.5), offset=np.float64(NAN))
    found = json.loads(encode_record(row))
    assert (found["noise"], found["offset"]) == (0.5, None)
