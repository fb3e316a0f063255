"""A model's response against naive twins and the textbook."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from monitor.identify.response import LAG, RAMP, STEP, load_of_shape, load_response
from monitor.identify.response import response as fast_response
from tests.support.twins import response


@settings(max_examples=25)
@given(
    steps=st.lists(st.floats(0.05, 1.5), min_size=6, max_size=25),
    kind=st.sampled_from([0, 1]),
    dead_time=st.floats(0.0, 6.0),
    lag=st.sampled_from([0.0, 0.3, 1.0, 4.0]),
    lag2=st.sampled_from([0.0, 0.5, 1.0, 4.0]),
    seed=st.integers(0, 1000),
)
@example([0.3] * 10, 1, 0.7, 1.0, 1.0, 1)
@example([0.3] * 10, 0, 50.0, 1.0, 0.0, 1)
@example([0.3] * 10, 0, 0.7, 4.0, 1.0, 1)
@example([0.3] * 10, 0, 0.7, 1.0, 1.0, 1)
@example([0.3] * 10, 1, 0.0, 0.0, 0.0, 1)
@example(
    [0.5] * 10, 1, 0.5, 0.0, 0.0, 1
)  # dead times as long as one step and as three, exact numbers and not
@example([0.3] * 10, 1, 0.3, 0.0, 0.0, 1)
@example([0.3] * 10, 1, 0.9, 0.0, 0.0, 1)
@example([0.3] * 10, 0, 0.9, 0.0, 0.0, 1)
def test_response_equals_its_naive_twin(steps, kind, dead_time, lag, lag2, seed):
    """Exact for held input at uneven times, any dead time, no lag; equal lags are taken a thousandth apart."""
    if lag < lag2:
        lag2 = 0.0
    t = np.cumsum(np.array(steps)) - 1.0
    u = np.random.default_rng(seed).normal(size=len(t))
    fast = fast_response(t, u, kind, dead_time, lag, lag2)
    slow = response(t, u, kind, dead_time, lag, lag2)
    scale = max(1.0, float(np.max(np.abs(u)))) * max(1.0, float(np.ptp(t)) if kind == 0 else 1.0)
    assert np.max(np.abs(fast - slow)) < (1e-3 if lag == lag2 != 0.0 else 1e-9) * scale


def test_response_to_a_step_is_the_textbooks():
    """A ramp after dead time and lag; a first-order rise."""
    t = np.arange(0.0, 60.0)
    u = np.ones(60)
    after = np.maximum(t - 7.5, 0.0)
    ramp = after - 4.0 * (1 - np.exp(-after / 4.0))
    np.testing.assert_allclose(fast_response(t, u, 0, 7.5, 4.0, 0.0), ramp, atol=1e-12)
    np.testing.assert_allclose(fast_response(t, u, 1, 7.5, 4.0, 0.0), 1 - np.exp(-after / 4.0), atol=1e-12)


@settings(max_examples=25)
@given(
    kind=st.sampled_from([0, 1]),
    onset=st.integers(0, 20),
    dead_time=st.floats(0.0, 9.0),
    lag=st.sampled_from([0.0, 0.3, 4.0]),
    lag2=st.sampled_from([0.0, 0.2, 4.0]),
    seed=st.integers(0, 1000),
)
def test_a_load_acts_as_op_does(kind, onset, dead_time, lag, lag2, seed):
    """A load step at a sample's instant moves PV as OP's own step there does, at uneven times."""
    if lag < lag2:
        lag2 = 0.0
    t = np.cumsum(np.random.default_rng(seed).choice([0.5, 0.5, 1.0], size=60))
    by_op = fast_response(t, (np.arange(60) >= onset).astype(float), kind, dead_time, lag, lag2)
    by_load = load_response(t - t[onset], kind, 1.0, dead_time, lag, lag2)
    at_the_jump = (lag == 0.0) & (np.abs(t - t[onset] - dead_time) < 1e-9)  # before or after: both are right
    np.testing.assert_allclose(by_load[~at_the_jump], by_op[~at_the_jump], atol=1e-9)


@settings(max_examples=40)
@given(
    kind=st.sampled_from([0, 1]),
    dead_time=st.floats(0.0, 5.0),
    lag=st.sampled_from([0.0, 0.5, 3.0, 8.0]),
    lag2=st.sampled_from([0.0, 0.4, 2.0]),
    width=st.sampled_from([0.5, 2.0, 3.0, 20.0]),
    shape=st.sampled_from([RAMP, LAG]),
)
@example(kind=0, dead_time=1.0, lag=3.0, lag2=0.0, width=3.0, shape=LAG)  # both lags alike
@example(kind=1, dead_time=1.0, lag=8.0, lag2=2.0, width=2.0, shape=LAG)
def test_a_load_of_another_shape_is_a_sum_of_small_steps(kind, dead_time, lag, lag2, width, shape):
    """Of 4000 of them; equal lags are taken some thousandths apart."""
    lag2 = min(lag2, lag)
    t = np.arange(0.0, 80.0, 1.3)
    shares = (np.arange(4000) + 0.5) / 4000
    starts = width * shares if shape == RAMP else -width * np.log1p(-shares)
    summed = np.mean([load_response(t - s, kind, 0.7, dead_time, lag, lag2) for s in starts], axis=0)
    fast = load_of_shape(t, kind, 0.7, dead_time, lag, lag2, width, shape)
    assert np.max(np.abs(fast - summed)) < 3e-3 * np.max(np.abs(summed))


@pytest.mark.parametrize("shape", [STEP, RAMP, LAG])
def test_a_load_that_takes_no_time_is_a_step(shape):
    t = np.arange(0.0, 80.0, 1.3)
    step = load_response(t, 0, 0.7, 2.0, 5.0, 1.0)
    np.testing.assert_array_equal(load_of_shape(t, 0, 0.7, 2.0, 5.0, 1.0, 0.0, shape), step)
