"""A window thinned to blocks keeps OP's integral; innovations are generalised least squares."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from monitor.identify.projection import Beside, blocks, filter_of, project


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


def covariance(t: np.ndarray, order: int, ratio: float) -> np.ndarray:
    """Return the covariance of white noise of variance 1 and a walk of PV's level or trend from the first point on."""
    s = t - t[0]
    low, high = np.minimum.outer(s, s), np.maximum.outer(s, s)
    walk = low if order == 1 else low**2 * (3.0 * high - low) / 6.0
    return np.eye(len(t)) + ratio * walk


@settings(max_examples=40)
@given(
    n=st.integers(6, 60),
    order=st.sampled_from([1, 2]),
    ratio=st.floats(1e-4, 10.0),
    sloped=st.booleans(),
    seed=st.integers(0, 1000),
)
def test_innovations_are_generalised_least_squares(n, order, ratio, sloped, seed):
    """Sums of squares and products of innovations are those weighed by the inverse of the whole covariance (twin)."""
    rng = np.random.default_rng(seed)
    t = np.cumsum(rng.uniform(0.5, 1.5, n))
    columns = rng.normal(size=(n, 2)) + 5.0
    free = np.vander(t - t[0], 2 if order == 2 or sloped else 1, increasing=True)
    inverse = np.linalg.inv(covariance(t, order, ratio))
    weight = inverse - inverse @ free @ np.linalg.inv(free.T @ inverse @ free) @ free.T @ inverse
    found = np.column_stack(
        [project(c.copy(), filter_of(t, Beside(sloped, order, ratio))) for c in columns.T]
    )
    np.testing.assert_allclose(found.T @ found, columns.T @ weight @ columns, rtol=1e-4, atol=1e-5)


@pytest.mark.parametrize("order", [1, 2])
def test_innovations_variances_are_the_likelihoods(order):
    """The sum of their logarithms differs by what the covariance's determinant does, from one ratio to another."""
    t = np.cumsum(np.random.default_rng(1).uniform(0.5, 1.5, 40))
    free = np.vander(t - t[0], order, increasing=True)

    def whole(ratio):
        c = covariance(t, order, ratio)
        return np.linalg.slogdet(c)[1] + np.linalg.slogdet(free.T @ np.linalg.solve(c, free))[1]

    volumes = [filter_of(t, Beside(False, order, ratio)).volume for ratio in (0.01, 1.0)]
    assert volumes[1] - volumes[0] == pytest.approx(whole(1.0) - whole(0.01), abs=1e-3)
