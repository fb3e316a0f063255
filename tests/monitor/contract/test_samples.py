"""Samples as columns."""

from __future__ import annotations

import numpy as np
import pytest

from monitor.contract.samples import QUALITY_GOOD, Samples
from tests.support.samples import join


def three() -> Samples:
    return Samples.of([0, 1, 0], [10, 10, 20], [1.0, 2.0, 3.0], 5, [7, 8, 9], [True, False, True])


def test_columns_have_their_types_whatever_they_are_made_of():
    """A scalar stands for all rows; absent modes and qualities are automatic and good."""
    samples = three()
    assert len(samples) == 3
    assert [c.dtype for c in (samples.loop, samples.time, samples.pv, samples.auto)] == [
        np.int32, np.int64, np.float64, np.bool_,
    ]  # fmt: skip
    assert samples.pv.tolist() == [5.0, 5.0, 5.0]
    assert samples.quality.tolist() == [QUALITY_GOOD] * 3
    assert Samples.of(0, [1, 2], 0, 0, 0).auto.tolist() == [True, True]


@pytest.mark.parametrize("wrong", ["loop", "sp", "pv", "op", "auto", "quality"])
def test_a_column_of_another_length_is_named(wrong):
    columns = {"loop": 0, "time": [1, 2, 3], "sp": 0, "pv": 0, "op": 0, wrong: [0, 0]}
    with pytest.raises(ValueError, match=rf"column {wrong} has shape \(2,\), expected \(3,\)"):
        Samples.of(**columns)


def test_taken_and_joined_again():
    samples = three()
    parts = [samples.take(slice(0, 2)), samples.take([2])]
    for name in ("loop", "time", "sp", "pv", "op", "auto", "quality"):
        np.testing.assert_array_equal(getattr(join(parts), name), getattr(samples, name))
    assert len(samples.take(samples.auto)) == 2


def test_each_loop_s_samples_in_their_order():
    samples = Samples.of([2, 0, 2, 0], [1, 2, 3, 4], 0.0, [5.0, 6.0, 7.0, 8.0], 0.0)
    assert [(code, own.pv.tolist()) for code, own in samples.by_loop()] == [(0, [6.0, 8.0]), (2, [5.0, 7.0])]
