"""Laws that are no PID of the error as recorded, by name; and none where the law is linear."""

from __future__ import annotations

import math

import numpy as np
import pytest

from monitor.contract.loops import Loop
from monitor.identify.controller import known_of
from monitor.identify.controller_fit import Place, estimate, left_at
from monitor.identify.controller_other import (
    SQUARED,
    setpoint_inside,
    varying_columns,
    varying_gain,
    with_derivative,
    working_setpoint,
)
from monitor.identify.controller_rows import Rows, lay_out
from tests.support.controllers import Block, recorded, window_of

NOWHERE = Place(0.0, 0.0, 0.0)


def rows_of(block: Block, **facts: float) -> Rows:
    rows = lay_out(window_of(*recorded(block, **facts)), 1.0, Loop(name="L"))
    assert rows is not None
    return rows


def varying(block: Block, **facts: float) -> str:
    rows, known = rows_of(block, **facts), known_of(block.facts())
    return varying_gain(rows, known, left_at(rows, known, np.full(4, np.nan), 1.0, NOWHERE))


@pytest.mark.parametrize("noise", [0.05, 0.2])
def test_a_gain_that_varies_is_named(noise: float) -> None:
    assert "square" in varying(Block(squared=3.0), noise=noise)
    assert "gap" in varying(Block(gap=1.0), noise=noise)
    assert varying(Block(gap=noise), noise=noise) == ""  # noise alone crosses such an edge
    assert varying(Block(), noise=noise) == ""


def test_squared_columns() -> None:
    e, x = np.array([1.0, -2.0]), np.array([[1.0, 1.0, 0.5, 0.0], [-2.0, -1.0, -3.0, 0.0]])
    out = varying_columns(np.array([0.0, 2.0]), e, x, SQUARED, 0.0)
    np.testing.assert_allclose(out[1, :5], [-4.0, -8.0, -6.0, -1.0, -12.0])


def test_a_working_set_point() -> None:
    time, sp = np.arange(5.0), np.array([0.0, 2.0, 2.0, 2.0, 2.0])
    np.testing.assert_allclose(working_setpoint(time, sp, 0.5, 0.0), [0.0, 0.5, 1.0, 1.5, 2.0])
    np.testing.assert_allclose(working_setpoint(time, sp, 0.0, 1.0), 2.0 - 2.0 * 0.5 ** np.arange(5.0))


def test_a_set_point_that_the_block_ramps() -> None:
    block = Block(ramp=0.05)
    inside = setpoint_inside(rows_of(block, noise=0.05), known_of(block.facts()))
    assert inside is not None
    assert inside.rate == pytest.approx(0.05, rel=0.01)
    assert "ramp" in inside.words
    assert setpoint_inside(rows_of(Block(), noise=0.05), known_of(Block().facts())) is None


def test_a_derivative_filter_is_found() -> None:
    block = Block(td=8.0, tf=2.3)
    rows, known = rows_of(block, noise=0.1), known_of(Block().facts())
    other = with_derivative(rows, known, 1.0)
    assert other.tf == pytest.approx(2.3, rel=0.01)
    kp, _, kd, _ = estimate(rows, other, 1.0, NOWHERE).gains
    assert kd / kp == pytest.approx(8.0, rel=0.01)
    assert math.isclose(kp, 1.5, rel_tol=0.01)
