"""Windows of five cycles against a twin in plain numpy, and what a run of them is."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from monitor.health import swing_windows as own
from monitor.health.swing_windows import LAGS, LEAST_SCORE, LINES, MOST_RUNS, runs_of
from tests.monitor.health.cycles import Array, noise


def naive_acf(x: Array, start: int, length: int, lag: int) -> float:
    """Correlation of a window with itself, free of its line."""
    part, at = x[start : start + length], np.arange(length)
    part = part - np.polyval(np.polyfit(at, part, 1), at)
    one, other = part[: length - lag], part[lag:]
    return float(one @ other / np.sqrt((one @ one) * (other @ other)))


def line_of(x: Array, start: int, length: int) -> tuple[float, float]:
    slope, _ = np.polyfit(np.arange(length), x[start : start + length], 1)
    return float(np.mean(x[start : start + length])), float(slope)


@given(
    seed=st.integers(0, 1000),
    start=st.integers(0, 60),
    length=st.integers(20, 70),
    lag=st.integers(0, 15),
    slope=st.floats(-0.5, 0.5),
)
def test_the_tables_correlate_as_a_window_by_itself_does(
    seed: int, start: int, length: int, lag: int, slope: float
) -> None:
    n = 160
    x = np.zeros((2, n + LAGS))
    x[0, :n] = noise(n, seed) + slope * np.arange(n)
    sums = np.empty((n + 1, LINES + LAGS))
    own._sum_up(x, n, sums)
    found = own._acf(sums, start, length, lag, *line_of(x[0], start, length))
    assert found == pytest.approx(naive_acf(x[0], start, length, lag), abs=1e-8)


@pytest.mark.parametrize("t", [0.0, 0.25, 0.5, 0.9])
def test_the_cubic_is_exact_for_a_parabola(t: float) -> None:
    at = np.array([-1.0, 0.0, 1.0, 2.0])
    weights = np.array(own._cubic(t))
    assert weights.sum() == pytest.approx(1.0)
    assert weights @ at**2 == pytest.approx(t * t)


def test_a_sine_is_one_run_of_half_cycles_at_the_best_period() -> None:
    runs = runs_of(np.sin(2 * np.pi * np.arange(400) / 20), np.zeros(400))
    best = runs[np.argmax(runs[:, 4] / runs[:, 3])]
    assert best[2] / best[3] == pytest.approx(20.0, rel=0.02)
    assert best[4] / best[3] > 0.95
    assert best[5] / best[3] == pytest.approx(1.0, rel=0.05)  # amplitude
    assert best[3] == pytest.approx(2 * (20 - 5) + 1, abs=2)
    near = runs[np.abs(runs[:, 2] / runs[:, 3] / 20.0 - 1.0) < 0.15]
    assert len(near) > 1
    assert len(np.unique(near[:, 6])) == 1  # are one oscillation


def test_a_set_point_that_swings_with_the_error_is_no_run() -> None:
    x = np.sin(2 * np.pi * np.arange(400) / 20)
    square = 0.5 * np.sign(x)
    assert not len(runs_of(x, square))
    assert len(runs_of(x, np.where(np.arange(400) > 200, 2.0, 0.0)))  # one step is not with it


def test_what_dies_away_and_what_comes_in_pulses_does_not_count() -> None:
    t = np.arange(400)
    fading = np.exp(-t / 20.0) * np.sin(2 * np.pi * t / 20)
    pulses = (t % 40 < 3) - 1.0 * ((t + 20) % 40 < 3)
    for x in (fading, pulses):
        runs = runs_of(x + 0.01 * noise(400), np.zeros(400))
        assert not len(runs)


def test_runs_are_bounded_and_score_what_they_must() -> None:
    x = np.concatenate([np.sin(2 * np.pi * np.arange(60) / (5 + k % 7)) for k in range(60)])
    runs = runs_of(x, np.zeros(len(x)))
    assert 0 < len(runs) <= MOST_RUNS
    assert (runs[:, 4] / runs[:, 3] >= LEAST_SCORE).all()
    assert (runs[:, 1] <= len(x)).all()
