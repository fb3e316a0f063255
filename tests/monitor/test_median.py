"""Median and quantiles are NumPy's, of any column."""

from __future__ import annotations

import math

import numpy as np
import pytest

from monitor.median import median, quantile


@pytest.mark.parametrize("n", [1, 2, 3, 10, 501])
def test_is_that_of_numpy(n: int) -> None:
    """To the last bit, for odd and even numbers of values, and for whole numbers."""
    values = np.random.default_rng(n).normal(size=n)
    assert median(values) == np.median(values)
    assert median(list(values)) == np.median(values)
    whole = np.round(100.0 * values).astype(np.int64)
    assert median(whole) == np.median(whole)


def test_a_missing_value_or_none_has_none() -> None:
    """As NumPy's, but without a warning where there are no values."""
    assert math.isnan(median([1.0, math.nan, 2.0]))
    assert math.isnan(median(np.zeros(0)))


@pytest.mark.parametrize("n", [1, 2, 3, 10, 501])
def test_quantiles_are_those_of_numpy(n: int) -> None:
    values, shares = np.random.default_rng(n).normal(size=n), (0.0, 0.1, 0.3, 0.5, 0.77, 0.9, 1.0)
    assert quantile(values, *shares) == np.quantile(values, shares).tolist()
    assert all(map(math.isnan, quantile([1.0, math.nan, 2.0], 0.1, 0.9)))
