"""OP's travel is its way, not its noise, at any sampling."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

from tests.monitor.health.tools import N, health, look, noise, run, samples_of


def test_travel_counts_the_path_not_the_noise():
    """A sine of amplitude 5 goes 20 a cycle and turns twice, with or without noise; noise alone goes nowhere."""
    t = np.arange(20 * N)
    swing = 30 + 5 * np.sin(2 * np.pi * t / 500)
    for sigma in (0.0, 0.2):
        found = health(50.0, 50 + noise(len(t), 1), swing + sigma * noise(len(t)))
        assert found.travel_per_hour == pytest.approx(20 * 3600 / 500, rel=0.02)
        assert found.reversals_per_hour == pytest.approx(2 * 3600 / 500, rel=0.02)
    still = health(50.0, 50 + noise(len(t), 1), 30 + 0.2 * noise(len(t)))
    assert still.travel_per_hour == pytest.approx(0, abs=2)
    assert still.op_noise == pytest.approx(0.2, rel=0.05)


@pytest.mark.parametrize("every", [2, 5, 10])
def test_travel_does_not_depend_on_the_sampling(every):
    """Nor do mean error and offset."""
    t = np.arange(40_000)
    swing = np.sin(2 * np.pi * t / 700)
    fine = samples_of(50.0, 50.3 + swing + 0.1 * noise(len(t)), 30 + 5 * swing + 0.3 * noise(len(t), 1))
    a, b = look(run(fine)), look(run(fine.take(slice(None, None, every))))
    for name in ("travel_per_hour", "mean_abs_e", "offset", "oscillation_period"):
        assert getattr(b, name) == pytest.approx(getattr(a, name), rel=0.05)


@pytest.mark.parametrize("every", [2, 5, 10])
def test_travel_of_irregular_swings_near_the_noise_does_not_depend_on_the_sampling(every):
    """A resonance that noise excites: its swings are of all sizes, 8 standard deviations of the noise on average."""
    n, r = 80_000, 0.99
    swing = lfilter([1], [1, -2 * r * np.cos(2 * np.pi / 300), r * r], noise(n, 2))
    op = 30 + 3 * swing / swing.std() + noise(n, 1)
    fine = samples_of(50.0, 50 + noise(n), op)
    a, b = look(run(fine)), look(run(fine.take(slice(None, None, every))))
    assert 5 < a.travel_per_hour / a.reversals_per_hour < 12
    assert b.travel_per_hour == pytest.approx(a.travel_per_hour, rel=0.05)
    assert b.reversals_per_hour == pytest.approx(a.reversals_per_hour, rel=0.1)


def test_an_output_whose_noise_grows_has_the_new_one():
    """A hundredfold, halfway."""
    t = np.arange(40_000)
    grown = np.where(t < 20_000, 0.02, 2.0)
    found = health(50.0, 50 + noise(len(t)), 30 + 30 * np.sin(t / 100) + grown * noise(len(t), 1))
    assert found.op_noise == pytest.approx(2.0, rel=0.1)
    assert found.travel_per_hour == pytest.approx(120 * 3600 / (200 * np.pi), rel=0.05)


def test_travel_is_withheld_where_chance_decides():
    """Swings as large as the noise: none. A single clear move counts, and an output in its noise rests."""
    t = np.arange(40_000)
    assert (
        health(50.0, 50 + noise(len(t)), 30 + 1.3 * np.sin(t / 60) + noise(len(t), 1)).travel_per_hour is None
    )
    moved = health(50.0, 50 + noise(len(t)), 30 + 20 * (t > 20_000) + noise(len(t), 1))
    assert moved.travel_per_hour == pytest.approx(20 * 3600 / len(t), rel=0.1)
    assert health(50.0, 50 + noise(len(t)), 30 + noise(len(t), 1)).travel_per_hour == 0.0
