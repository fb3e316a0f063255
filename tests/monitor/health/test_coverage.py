"""The time that a loop was watched, and in which mode."""

from __future__ import annotations

import numpy as np
import pytest

from tests.monitor.health.tools import N, health, noise


def test_manual_and_coverage_are_shares_of_time():
    """A quarter in manual; a tenth of the time missing in gaps."""
    auto = np.arange(N) % 400 >= 100
    assert health(50.0, 50 + noise(), 30.0, auto).manual == pytest.approx(0.25, abs=0.02)
    time = np.arange(N) + 100.0 * (np.arange(N) // 1000)
    assert health(50.0, 50 + noise(), 30.0, time=time).coverage == pytest.approx(N / (N + 200), abs=2e-3)


@pytest.mark.parametrize(("hours", "coverage"), [(5, 0.1), (7, 1.0), (72, 1.0)])
def test_what_lies_between_slices_is_not_missing(hours, coverage):
    """An export of Monday's and Thursday's data has no missing Tuesday; five hours are a gap."""
    time = np.arange(N) + 3600.0 * hours * (np.arange(N) // (N // 2))
    found = health(50.0, 50 + noise(), 30.0, time=time)
    assert found.coverage == pytest.approx(coverage if hours > 6 else N / (N + 3600 * hours), abs=0.01)


def test_a_missed_sample_is_bridged_but_not_covered():
    """Every tenth sample is missing: of its two seconds, half of one is counted beside the other."""
    time = np.arange(N)[np.arange(N) % 10 > 0]
    found = health(50.0, 50 + noise(len(time)), 30.0, time=time, period=1.0)
    assert found.coverage == pytest.approx(0.95, abs=2e-3)
