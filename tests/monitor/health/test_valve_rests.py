"""What PV does while a valve rests: stretches built by hand."""

from __future__ import annotations

import numpy as np
import pytest

from monitor.health.valve_fit import SHAPES, path_of
from monitor.health.valve_rests import means_of, rests_of

PLAY = SHAPES.index("play")


def swing(n: int = 1000, period: int = 200, size: float = 4.0) -> np.ndarray:
    """OP as a triangle."""
    return size * (2 * np.abs(2 * ((np.arange(n) / period) % 1.0) - 1) - 1)


def rested(op: np.ndarray, w: float) -> np.ndarray:
    v = np.empty(len(op))
    path_of(op, w, PLAY, 0, v)
    return v


def test_a_valve_that_rests_leaves_pv_quiet() -> None:
    op = swing()
    v = rested(op, 3.0)
    idle, share, quiet, travel, straight = rests_of(op, v, 3.0, PLAY, means_of(v))
    assert idle == 9  # two a cycle, but for the first, of which only half is seen
    assert share == pytest.approx(9 * 38 / 1000, rel=0.1)
    assert quiet == straight == 0.0
    assert travel == pytest.approx(9.5 * (8.0 - 3.0) / 3.0, rel=0.1)


def test_a_valve_that_does_not_rest_leaves_pv_moving() -> None:
    op = swing()
    quiet = rests_of(op, rested(op, 3.0), 3.0, PLAY, means_of(op))[2]
    assert quiet > 0.05


def test_a_ramp_is_straight_and_not_quiet() -> None:
    op = swing()
    v = rested(op, 6.0)
    _, _, quiet, _, straight = rests_of(op, v, 6.0, PLAY, means_of(np.cumsum(v)))
    assert quiet > 0.1
    assert straight < 0.01 * quiet


@pytest.mark.parametrize("scale", [1e-3, 1e4])
def test_units_do_not_matter(scale: float) -> None:
    op = swing()
    v = rested(op, 3.0)
    one = rests_of(op, v, 3.0, PLAY, means_of(op))
    assert rests_of(scale * op, scale * v, scale * 3.0, PLAY, means_of(scale * op)) == pytest.approx(one)


def test_nothing_rests_where_op_rests() -> None:
    op = np.zeros(500)
    assert rests_of(op, op, 1.0, PLAY, means_of(op))[0] == 0.0
