"""A quality means the same wherever it comes from."""

from __future__ import annotations

import json

import numpy as np
import pyarrow as pa
import pytest

from monitor.contract.quality import opc_quality
from monitor.contract.samples import QUALITY_UNCERTAIN
from tests.monitor.wire.tools import FRAME, NAN, columns, decode, frame, refused


@pytest.mark.parametrize(
    ("code", "byte"),
    [(192, 192), (0, 0), (216, 216), (-5, 0), (0x4C0, 192), (0x4000_0000, 64), (0x8000_0000, 0), (1e30, 0)],
)
def test_quality_means_the_same_in_json_and_in_frames(code, byte):
    """An OPC code's byte, a vendor's upper byte left out; of an OPC UA status the top bits; negative is bad."""
    out, decoder = decode(
        ("plant/L0/pv", json.dumps({"v": 1, "q": code}).encode()),
        ("plant/L0", json.dumps({"pv": 1, "q": code}).encode()),
        (FRAME, frame(columns(1, quality=pa.array([float(code)])))),
    )
    assert out["quality"].tolist() == [byte] * 3
    assert not refused(decoder)


def test_quality_that_is_not_given_is_good():
    """Null and NaN are not given; so the audit reads an empty cell."""
    out, decoder = decode(
        ("plant/L0/pv", b'{"v":1,"q":null}'),
        (FRAME, frame(columns(2, quality=pa.array([None, NAN], pa.float64())))),
    )
    assert out["quality"].tolist() == [192, 192, 192]
    assert not refused(decoder)
    assert opc_quality(np.array([NAN, 70000.0])).tolist() == [192, 70000 & 0xFF]


def test_uncertain_is_below_good():
    """The codes of the samples and of the wire are the same."""
    assert opc_quality(np.array([0x4000_0000]))[0] == QUALITY_UNCERTAIN
