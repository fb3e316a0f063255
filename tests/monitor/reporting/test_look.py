"""Whether rows come by exception, told by their intervals and by the sizes of PV's changes; it is said of the loop."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import ArrayLike, NDArray

from monitor.contract.loops import Loop
from monitor.contract.records import SETPOINT
from monitor.contract.samples import Samples
from monitor.reporting.look import is_regular, look, median_step, steps_of
from monitor.reporting.state import ROW
from tests.monitor.reporting.tools import by_exception
from tests.support.plants import START, pi_loop, times
from tests.support.runs import run

LOOP = Loop(name="L", process="integrating", kp=1.2, ti=200.0, op_low=0, op_high=100, pv_low=0, pv_high=100)
"""Slow for a gain of 0.01 and a dead time of 10 s."""
S = 10**9
"""Nanoseconds of a second."""
STEPS = [2.0, 5.0, 5.0, 7.0, 20.0, 30.0, 40.0, 50.0, 60.0, 70.0] * 3
"""Intervals of rows on change [s]."""


def rows(steps: ArrayLike, pv: ArrayLike, op: ArrayLike = 0.0) -> NDArray[Any]:
    """Rows with these intervals [s] and these changes of PV and OP between them."""
    steps = np.asarray(steps, float)
    found = np.zeros(len(steps) + 1, ROW)
    found["time"] = START
    found["time"][1:] += np.round(np.cumsum(steps) * S).astype(np.int64)
    for name, changes in (("pv", pv), ("op", op)):
        found[name][1:] = np.cumsum(np.broadcast_to(changes, steps.shape))
    return found


def loose(seed: int = 0) -> NDArray[np.float64]:
    """Changes of all sizes."""
    return np.random.default_rng(seed).normal(size=len(STEPS))


def banded(band: float) -> NDArray[np.float64]:
    """Changes of one size, up and down."""
    return band * np.resize([1.0, 1.0, -1.0], len(STEPS))


def test_changes_of_one_size_are_a_dead_band():
    """Which is told, with the shortest interval as the rate: 2 s come three times, and 70 s are no heartbeat."""
    period, _, band = look(rows(STEPS, banded(0.3)), 0)
    assert period == 2 * S
    assert band == pytest.approx(0.3)


def test_the_sizes_of_op_tell_it_where_those_of_pv_do_not():
    """Rows for the sake of OP bring a PV of any change; neither of one size is no exception reporting."""
    assert look(rows(STEPS, loose(), banded(2.0)), 0)[0] > 0
    assert look(rows(STEPS, loose(), loose(1)), 0)[0] == 0


def test_op_that_jumps_with_the_set_point_tells_nothing():
    """Of any size, it does not hide that OP's other changes are of one."""
    op = banded(2.0)
    op[10] = 60.0
    jump = rows(STEPS, loose(), op)
    assert look(jump, 0)[0] == 0
    jump["sp"][11:] = 5.0
    assert look(jump, 0)[0] > 0


def test_rows_at_a_rate_do_not_come_by_exception():
    """However alike the changes are, and though one row in fifteen comes late; nor does a PV that stands still."""
    steps = np.ones(30)
    steps[::15] = 5.0
    assert look(rows(steps, banded(0.3)), 0) == (0, 0, 0.0)
    assert look(rows(STEPS, 0.0, banded(2.0)), 0) == (0, 0, 0.0)


def test_one_short_interval_is_a_glitch():
    steps = np.array(STEPS)
    steps[7] = 0.001
    assert look(rows(steps, banded(0.3)), 0)[0] == 2 * S


def test_a_period_of_the_table_is_the_rate():
    assert look(rows(STEPS, banded(0.3)), 5 * S)[0] == 5 * S


@pytest.mark.parametrize(
    ("longest", "beat"),
    [
        ([600.0, 598.0, 601.0], 601.0),
        ([600.0, 598.0, 601.0, 5000.0], 601.0),  # after an outlier
        ([400.0, 500.0, 600.0], 0.0),  # of any length
        ([600.0, 598.0], 0.0),  # too few
        ([19.0, 19.0, 19.0], 0.0),  # of few periods: by chance
    ],
)
def test_an_interval_that_comes_again_and_again_is_a_heartbeat(longest, beat):
    steps = [2.0] * 10 + [7.0] * (20 - len(longest)) + longest
    _, found, _ = look(rows(steps, np.resize([0.3, -0.3], len(steps))), 0)
    assert found == beat * S


def test_is_regular():
    """Nine in ten of the intervals at most half as long again as the period."""
    assert is_regular(rows([1.4] * 28 + [50.0] * 2, 0.3), S)
    assert not is_regular(rows([1.4] * 26 + [50.0] * 4, 0.3), S)
    assert not is_regular(rows([1.6] * 30, 0.3), S)


def test_intervals_in_order():
    """The shortest first; the one in the middle is the usual one, and never 0."""
    some = rows([5.0, 1.0, 100.0], 0.3)
    assert steps_of(some).tolist() == [S, 5 * S, 100 * S]
    assert median_step(rows([5.0, 1.0, 100.0, 5.0, 2.0], 0.3)) == 5 * S
    assert median_step(rows([0.0] * 5, 0.3)) == 1


def test_without_a_step_it_is_named_with_the_way_out():
    sp = np.full(12_000, 50.0)
    pv, op = pi_loop(sp, kp=1.2, ti=200.0, gain=0.01, dead=10, noise=0.1)
    pv += np.interp(np.arange(12_000), [0, 3000, 6000, 9000, 12_000], [0, 4, 0, 4, 0])
    engine, seen = run(
        LOOP, by_exception(Samples.of(0, times(len(sp)), sp, pv, op), 0.25, 600.0, every=False)
    )
    row = engine.row(0)
    assert "exception_reported" in row.flags
    assert "switch exception reporting off" in row.action
    assert "idle" not in row.flags
    assert not [a for a in seen.assessments if a.kind == SETPOINT]
