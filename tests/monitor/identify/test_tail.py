"""Tails of what was before are told from loads."""

from __future__ import annotations

import numpy as np
import pytest

from monitor.detect.event import EventWindow
from monitor.identify.direct import fit_kinds
from monitor.identify.tail import is_tail
from tests.support.plants import pi_loop
from tuners.models import INTEGRATING, SELF_REGULATING


def window(first: int, load_at: int | None, noise: float) -> EventWindow:
    """A loop that answers a set-point step of 10 at sample 100, from ``first`` on, perhaps with a load."""
    sp = np.where(np.arange(900) < 100, 50.0, 60.0)
    pv, op = pi_loop(
        sp,
        kp=0.8,
        ti=60.0,
        lag=8.0,
        noise=noise,
        load=lambda k: 8.0 if load_at is not None and k >= load_at else 0.0,
    )
    time = np.arange(900.0)[first:] - first - 20.0
    return EventWindow(time, sp[first:], pv[first:], op[first:], 20)


@pytest.mark.parametrize("noise", [0.0, 0.05, 0.2])
@pytest.mark.parametrize("first", [103, 120, 150])
def test_a_response_that_began_before_the_data_is_a_tail(first, noise):
    shown = window(first, None, noise)
    fits = fit_kinds(shown, [INTEGRATING, SELF_REGULATING], True, 1.0)
    assert is_tail(shown, fits[0] if fits else None, 1.0)


@pytest.mark.parametrize("noise", [0.0, 0.05, 0.2])
@pytest.mark.parametrize("load_at", [500, 600])
def test_a_load_after_the_loop_had_come_to_rest_is_none(load_at, noise):
    shown = window(load_at - 60, load_at, noise)
    fit = fit_kinds(shown, [INTEGRATING], True, 1.0)[0]
    assert not is_tail(shown, fit, 1.0)


def test_what_did_not_move_is_none():
    still = EventWindow(np.arange(50.0), np.full(50, 1.0), np.full(50, 1.0), np.full(50, 2.0), 5)
    assert not is_tail(still, None, 1.0)
