"""Which rows of a window tell something of the law."""

from __future__ import annotations

import numpy as np
import pytest

from monitor.contract.loops import Loop
from monitor.detect.event import EventWindow
from monitor.identify.controller_rows import lay_out, odd_pace, scan_rows
from tests.support.controllers import Block, recorded, window_of


def test_rows_at_a_limit_are_left_out_and_the_constant_begins_anew() -> None:
    sp, pv, op = recorded(Block(high=56.0), noise=0.1)
    rows = lay_out(window_of(sp, pv, op), 1.0, Loop(name="L"))
    assert rows is not None
    assert not rows.use[op == 56.0].any()
    assert rows.use[op < 56.0].all()


def test_coarse_points_of_the_far_past_are_left_out() -> None:
    sp, pv, op = recorded(Block(), noise=0.1)
    window = window_of(sp, pv, op)
    kept = np.r_[0:64:8, 64 : len(sp)]
    coarse = EventWindow(*(c[kept] for c in (window.time, sp, pv, op)), before=128 - 64 + 8)
    rows = lay_out(coarse, 1.0, Loop(name="L"))
    assert rows is not None
    assert len(rows) == len(sp) - 64 + 1 or len(rows) == len(sp) - 64
    assert rows.before in {64, 65}


def test_the_pace_of_the_controller_is_seen_in_its_moves() -> None:
    for scan in (2, 3, 7):
        _, _, op = recorded(Block(scan=scan), noise=0.1)
        assert scan_rows(op)[0] == scan
    _, _, op = recorded(Block(), noise=0.1)
    assert scan_rows(op)[0] == 1
    assert scan_rows(np.round(op, 0))[0] == 1


def test_a_pace_that_is_no_whole_number_of_rows() -> None:
    _, _, op = recorded(Block(scan=5), n=800, noise=0.1)
    assert odd_pace(op[::2]) == pytest.approx(2.5, rel=0.01)
    assert odd_pace(op) == 0.0
    _, _, op = recorded(Block(), noise=0.1)
    assert odd_pace(op) == 0.0
    assert odd_pace(np.round(op, 1)) == 0.0


def test_a_rounded_output_is_known_by_its_step() -> None:
    sp, pv, op = recorded(Block(), noise=0.1)
    rounded = lay_out(window_of(sp, pv, np.round(op / 0.1) * 0.1), 1.0, Loop(name="L"))
    plain = lay_out(window_of(sp, pv, op), 1.0, Loop(name="L"))
    assert rounded is not None
    assert plain is not None
    assert abs(rounded.quantum - 0.1) < 1e-6
    assert plain.quantum == 0.0


def test_missing_samples_set_the_constant_free() -> None:
    sp, pv, op = recorded(Block(), noise=0.1)
    window = window_of(sp, pv, op)
    kept = np.delete(np.arange(len(sp)), [200, 201])
    rows = lay_out(
        EventWindow(*(c[kept] for c in (window.time, sp, pv, op)), before=128), 1.0, Loop(name="L")
    )
    assert rows is not None
    assert list(np.flatnonzero(rows.fresh)) == [0, 200]
