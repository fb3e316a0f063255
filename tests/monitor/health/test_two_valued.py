"""OP that takes two values: relays and pulse widths are named, and nothing else."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from monitor.health.two_valued import two_valued
from tests.support.places import SHARED


def pulses(n: int = 900, period: int = 30, duty: float = 0.4) -> np.ndarray:
    return np.where(np.arange(n) % period < duty * period, 100.0, 0.0)


@pytest.mark.parametrize("duty", [0.1, 0.4, 0.9])
def test_a_relay_is_named(duty: float) -> None:
    assert two_valued(pulses(duty=duty)) == 1.0


def test_an_output_from_0_to_1_is_named_too() -> None:
    assert two_valued(pulses() / 100.0) == 1.0


@given(st.floats(0.0, 0.8), st.integers(0, 1000))
def test_noise_at_the_levels_and_a_sample_on_the_way_do_not_matter(noise: float, seed: int) -> None:
    op = pulses() + noise * np.random.default_rng(seed).normal(size=900)
    at = np.flatnonzero(np.diff(pulses()) != 0.0)
    op[at] = 47.0
    share = two_valued(op)
    assert share is not None
    assert 0.9 < share < 1.0


def test_which_level_is_which_does_not_matter() -> None:
    op = pulses()
    assert two_valued(100.0 - op) == two_valued(op)
    assert two_valued(op[::-1]) == two_valued(op)


def test_missing_samples_are_left_out() -> None:
    op = pulses()
    op[::7] = np.nan
    assert two_valued(op) == 1.0
    assert two_valued(np.full(100, np.nan)) is None


def test_a_saturating_controller_is_none() -> None:
    t = np.arange(2000)
    assert two_valued(np.clip(50.0 + 150.0 * np.sin(2 * np.pi * t / 200), 0.0, 100.0)) is None


def test_an_output_in_coarse_steps_is_none() -> None:
    rng = np.random.default_rng(1)
    assert two_valued(45.0 + 0.5 * (rng.random(1000) < 0.5)) is None
    assert two_valued(np.round((45.0 + 5.0 * np.sin(np.arange(1000) / 50)) / 2.5) * 2.5) is None


def test_a_few_moves_of_an_operator_are_none() -> None:
    assert two_valued(np.repeat([20.0, 60.0, 20.0, 60.0], 250)) is None


def test_too_few_samples_are_none() -> None:
    assert two_valued(pulses(40)) is None


def test_the_recorded_relay() -> None:
    path = SHARED / "cases" / "relay-as-output" / "data.csv"
    if not path.is_file():
        pytest.skip("../shared/cases is not there")
    assert two_valued(pd.read_csv(path)["op"].to_numpy(float)) == pytest.approx(1.0, abs=0.02)
