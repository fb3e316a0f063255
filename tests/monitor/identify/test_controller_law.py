"""The columns are the block's own law; the local level is what it is said to be."""

from __future__ import annotations

import numpy as np
import pytest

from monitor.identify.controller_law import (
    columns,
    compared,
    left,
    left_by_known,
    products,
    scores,
    search,
    solved,
    whitened,
)
from tests.support.controllers import Block, recorded, window_of

ACTIVE = np.array([0, 1, 2, 3])


def rows(block: Block, **facts: float) -> tuple[np.ndarray, ...]:
    sp, pv, op = recorded(block, **facts)
    time = window_of(sp, pv, op).time
    return time, sp, pv, op, np.ones(len(sp), bool), np.arange(len(sp)) == 0


@pytest.mark.parametrize("block", [Block(td=8.0, pv_filter=6.0), Block(td=5.0, b=0.3, c=0.0, delay=2)])
def test_columns_are_the_law_of_a_block(block: Block) -> None:
    time, sp, pv, op, *_ = rows(block, noise=0.1)
    law = (block.td / 10, block.b, block.c, 1.0, 0.0)
    x = columns(time, sp, pv, law, block.pv_filter, block.delay)
    rest = op - x[:, :3] @ np.array([block.kp, block.kp / block.ti, block.kp * block.td])
    np.testing.assert_allclose(rest[100:], rest[100], atol=1e-6)  # the filter's start is forgotten


@pytest.mark.parametrize("walk", [0.0, 0.05, 1.0])
def test_innovations_are_those_of_the_full_covariance(walk: float) -> None:
    """Generalised least squares with the covariance written out, the constant free."""
    n, rng = 40, np.random.default_rng(1)
    x, y = rng.normal(size=(n, 2)), rng.normal(size=n).cumsum()
    use, fresh = np.ones(n, bool), np.arange(n) == 0
    white, _, m = whitened(x, y, use, fresh, walk)
    gains, _ = solved(products(white), np.array([0, 1]))
    cov = (1.0 - walk) * np.eye(n) + walk * np.minimum.outer(np.arange(n), np.arange(n))
    full = np.column_stack([x, np.ones(n)])
    inverse = np.linalg.pinv(cov)
    if walk == 1.0:  # its first row is the constant
        d = np.diff(np.eye(n), axis=0)
        inverse = d.T @ d
        full = x
    expected = np.linalg.solve(full.T @ inverse @ full, full.T @ inverse @ y)[:2]
    np.testing.assert_allclose(gains, expected, rtol=1e-6)
    assert m == n - 1


def test_what_is_left_is_that_of_the_residuals() -> None:
    rng = np.random.default_rng(2)
    white = rng.normal(size=(50, 5))
    m = products(white)
    np.testing.assert_allclose(m, white.T @ white)
    gains, squares = solved(m, ACTIVE)
    expected, rss, *_ = np.linalg.lstsq(white[:, :4], white[:, 4], rcond=None)
    np.testing.assert_allclose(gains, expected, rtol=1e-8)
    np.testing.assert_allclose([squares, left(m, gains)], rss[0], rtol=1e-8)
    known = np.array([0.1, 0.2, 0.3, 0.0])
    y = white[:, 4] - white[:, :3] @ known[:3]
    start = white[:, 3] * (white[:, 3] @ y) / (white[:, 3] @ white[:, 3])
    assert left_by_known(m, known) == pytest.approx(np.sum((y - start) ** 2))


def test_filter_and_delay_are_found_where_they_are() -> None:
    block = Block(pv_filter=7.3, delay=2)
    gains = np.array([block.kp, block.kp / block.ti, 0.0, 0.0])
    t, d, squares = search(
        rows(block, noise=0.1), (0.0, 1.0, 1.0, 1.0, 0.0), ACTIVE, gains, 1.0, (1.0, 60.0, -3.0, 12.0)
    )
    assert (t, d) == (pytest.approx(7.3, abs=0.01), 2.0)
    assert squares < 1e-6


def test_scores_without_reach_are_those_of_white() -> None:
    rng = np.random.default_rng(3)
    white = rng.normal(size=(60, 3))
    gains, active = np.zeros(2), np.array([0, 1])
    g = white[:, :2] * white[:, 2:]
    np.testing.assert_allclose(scores(white, gains, active, 0), g.T @ g)
    expected = g.T @ g + 0.5 * (g[1:].T @ g[:-1] + g[:-1].T @ g[1:])
    np.testing.assert_allclose(scores(white, gains, active, 1), expected)


def test_what_is_compared_is_the_rest_between_its_jumps() -> None:
    time, sp, pv, op, use, fresh = rows(Block(), noise=0.1)
    gains = np.array([1.5, 1.5 / 80.0, 0.0, 0.0])
    x = columns(time, sp, pv, (0.0, 1.0, 1.0, 1.0, 0.0), 0.0, 0)
    own = np.random.default_rng(0).normal(0.0, 0.02, len(op)) + np.where(np.arange(len(op)) < 300, 0.0, 7.0)
    jump, rest, allowed, moved, spread = compared(x, gains, op + own, use, fresh, 0.02, 0.0)
    assert list(np.flatnonzero(jump)) == [300]
    apart = [own[:300] - own[:300].mean(), own[300:] - own[300:].mean()]
    assert rest == pytest.approx(np.std(np.concatenate(apart)), rel=1e-6)
    assert moved == pytest.approx(np.std(x[:, :3] @ gains[:3]))
    assert allowed == pytest.approx(0.02 * moved)
    assert spread == pytest.approx(np.std(op + own))
