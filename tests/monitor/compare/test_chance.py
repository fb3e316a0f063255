"""Intervals of ratios hold what they promise, and nothing is said of too few values."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import combinations

import numpy as np
import pytest

from monitor.compare.chance import LEAST_SPELLS, MOST_VALUES, ratio_of_events, ratio_of_means
from monitor.contract.changes import LEVEL


@pytest.mark.parametrize(("n", "m"), [(4, 4), (3, 8), (1, 150), (0, 9)])
def test_too_few_events_tell_nothing(n: int, m: int) -> None:
    assert ratio_of_events([1.0] * n, [2.0] * m) is None
    assert ratio_of_events([1.0] * m, [2.0] * n) is None


@pytest.mark.parametrize(("n", "m"), [(5, 5), (4, 6), (3, 9)])
def test_the_least_that_tells_spans_all_ratios(n: int, m: int) -> None:
    """With so few, the interval goes from the least of all pairwise ratios to the largest."""
    x, y = np.linspace(1.0, 2.0, n), np.linspace(3.0, 7.0, m)
    found = ratio_of_events(x, y)
    assert found is not None
    assert found.low == pytest.approx(y.min() / x.max())
    assert found.high == pytest.approx(y.max() / x.min())


def test_the_interval_is_that_of_all_orders_counted() -> None:
    """A naive twin: of all ways to deal 12 ranks, the share whose rank sum is as extreme."""
    n, m = 5, 7
    sums = [sum(dealt) - n * (n - 1) // 2 for dealt in combinations(range(n + m), n)]
    tail = [np.mean(np.array(sums) <= u) for u in range(n * m + 1)]
    rank = sum(share <= (1 - LEVEL) / 2 for share in tail)
    rng = np.random.default_rng(1)
    x, y = np.exp(rng.normal(size=n)), np.exp(rng.normal(size=m))
    ratios = np.sort((y[:, None] / x[None, :]).ravel())
    found = ratio_of_events(x, y)
    assert found is not None
    assert found == pytest.approx((np.exp(np.median(np.log(ratios))), ratios[rank - 1], ratios[-rank]))


def test_an_outlier_moves_little() -> None:
    calm = [1.0, 1.1, 0.9, 1.05, 0.95, 1.0, 1.02, 0.98]
    found = ratio_of_events(calm, [*(2.0 * v for v in calm), 1e-6])
    assert found is not None
    assert found.value == pytest.approx(2.0, rel=0.1)
    assert found.low > 1.0


def test_the_newest_of_many_are_compared() -> None:
    found = ratio_of_events([9.0] * 1000 + [1.0] * MOST_VALUES, [2.0] * 1000)
    assert found is not None
    assert found.value == pytest.approx(2.0)


@pytest.mark.parametrize("seed", range(3))
def test_intervals_of_what_has_not_changed_hold_one(seed: int) -> None:
    rng = np.random.default_rng(seed)
    missed = 0
    for _ in range(300):
        x, y = np.exp(rng.normal(0, 0.3, (2, 10)))
        a, b = np.abs(rng.normal(1.0, 0.2, (2, 20)))
        for found in (ratio_of_events(x, y), ratio_of_means(hours(a), hours(b))):
            assert found is not None
            missed += not found.low <= 1.0 <= found.high
    assert missed <= 18  # 6 are expected at 99 %, at 95 % 30


def hours(means: Iterable[float]) -> list[tuple[float, float]]:
    return [(float(m), 3600.0) for m in means]


def test_means_weigh_by_time() -> None:
    found = ratio_of_means(hours(np.ones(8)), [(1.0, 3.0)] * 4 + [(5.0, 1.0)] * 4)
    assert found is not None
    assert found.value == pytest.approx(2.0)
    assert found.low < 1.0 < found.high


def test_few_spells_and_a_mean_of_zero_tell_nothing() -> None:
    few, many = hours(np.ones(LEAST_SPELLS - 1)), hours(np.ones(LEAST_SPELLS))
    assert ratio_of_means(few, many) is None
    assert ratio_of_means(many, hours(np.zeros(LEAST_SPELLS))) is None
    assert ratio_of_means(many, hours([2.0] * LEAST_SPELLS)) == pytest.approx((2.0, 2.0, 2.0))
