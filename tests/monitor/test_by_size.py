"""Values by their size, as NumPy's."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from monitor.by_size import median, median_of, nth, quantile, quantile_of, range_of

VALUES = st.lists(st.floats(-1e6, 1e6), min_size=1, max_size=40).map(np.array)


@given(VALUES)
def test_each_is_found_at_its_place(x: NDArray[np.float64]) -> None:
    """The values are moved about, none is lost."""
    for k in range(len(x)):
        moved = x.copy()
        assert nth(moved, k) == np.sort(x)[k]
        np.testing.assert_array_equal(np.sort(moved), np.sort(x))


@given(VALUES, st.floats(0.0, 1.0))
def test_median_quantile_and_range_are_numpys(x: NDArray[np.float64], share: float) -> None:
    assert median_of(x.copy()) == np.median(x)
    assert quantile_of(x.copy(), share) == pytest.approx(np.quantile(x, share), rel=1e-12, abs=1e-12)
    assert range_of(x) == np.ptp(x)


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
