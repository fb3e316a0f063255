"""A window thinned to blocks keeps OP's integral."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from monitor.identify.projection import blocks


@settings(max_examples=25)
@given(n=st.integers(12, 900), most=st.integers(10, 300), seed=st.integers(0, 1000))
def test_blocks_keep_the_integral_of_op(n, most, seed):
    """However a window is thinned: OP's integral at each block's start is that of all points, PV the mean."""
    rng = np.random.default_rng(seed)
    t, u, y = np.cumsum(rng.uniform(0.5, 1.5, n)), rng.normal(size=n), rng.normal(size=n)
    at, mean, since, held = blocks(t, u, y, most)
    size = -(-n // most)
    assert len(at) == n // size
    whole = np.concatenate([[0.0], np.cumsum(u[:-1] * np.diff(t))])
    thinned = np.concatenate([[0.0], np.cumsum(held[:-1] * np.diff(since))])
    np.testing.assert_allclose(thinned, whole[: len(at) * size : size], atol=1e-9)
    assert mean[-1] == pytest.approx(y[(len(at) - 1) * size : len(at) * size].mean())
