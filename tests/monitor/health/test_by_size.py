"""Values by their size, as NumPy's."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from monitor.health.by_size import median_of, nth, quantile_of, range_of

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
