"""A case and how its answer is put."""

from __future__ import annotations

import math

import numpy as np
import pytest

from monitor.identify.controller import known_of
from monitor.identify.controller_case import NOWHERE, Case, settings_of_gains
from monitor.identify.controller_fit import Estimate, Place
from monitor.identify.controller_rows import lay_out
from monitor.identify.controller_seen import AS_DECLARED, CONTRADICTED, UNRESOLVED
from tests.support.controllers import Block, recorded, window_of


def case_of(block: Block) -> Case:
    rows = lay_out(window_of(*recorded(block, noise=0.1)), 1.0, block.facts())
    assert rows is not None
    return Case(rows, rows, block.facts(), known_of(block.facts()))


def test_the_start_of_a_derivative_is_left_out() -> None:
    assert case_of(Block()).settled().rows.use.all()
    short, long = (case_of(Block(td=8.0, tf=tf)).settled().rows.use for tf in (0.5, 3.0))
    assert 0 < np.count_nonzero(~short) < np.count_nonzero(~long)
    # by then the start has faded to exp(-9)
    assert (3.0 / 4.0) ** (np.count_nonzero(~long) - 2) < math.exp(-9.0)


def test_what_is_said() -> None:
    case = case_of(Block())
    found = Estimate(
        np.array([1.6, 0.02, 0.0, 0.0]), np.full(3, 1e-3), np.array([1.6, 0.02, 0.0]), NOWHERE, 400
    )
    declared = case.controller(AS_DECLARED, found, NOWHERE, 1.2)
    assert declared.settings is not None
    assert (declared.settings.kp, declared.explained) == (1.5, 1.0)
    assert declared.kp.low <= 1.5 < declared.kp.value
    other = case.controller(CONTRADICTED, found, Place(2.0, 3.0, 0.0), 0.1)
    assert other.settings is not None
    assert other.settings.ti == pytest.approx(80.0)
    assert (other.pv_filter, other.op_delay, other.delay) == (2.0, 3.0, 5.0)
    assert case.controller(UNRESOLVED, found, NOWHERE, 0.0).settings is None


def test_gains_that_are_no_settings() -> None:
    known = known_of(Block().facts())
    assert settings_of_gains(np.array([1.0, -0.1, 0.0, 0.0]), known) is None
    assert settings_of_gains(np.array([0.0, 0.1, 0.0, 0.0]), known) is None
