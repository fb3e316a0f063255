"""Sums of products of a block."""

from __future__ import annotations

import numpy as np
import pytest

from monitor.health.block import BLOCK_LENGTH, add_products


@pytest.mark.parametrize("lags", [1, 30, 46])
def test_products_are_those_of_numpy(lags):
    """Added to what is there."""
    x = np.random.default_rng(0).normal(size=BLOCK_LENGTH)
    out = np.ones(lags)
    add_products(np.concatenate([x, np.zeros(lags)]), out)
    np.testing.assert_allclose(out, 1.0 + np.correlate(x, x, "full")[BLOCK_LENGTH - 1 :][:lags])
