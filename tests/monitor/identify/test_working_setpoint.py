"""The set point that the block works with, seen in OP."""

from __future__ import annotations

import numpy as np
import pytest

from monitor.detect.event import EventWindow
from monitor.identify.working_setpoint import working_setpoint
from tests.support.plants import pi_loop
from tuners.settings import Settings

KP, TI = 2.0, 40.0


def recorded(working: np.ndarray, step: float, noise: float = 0.02) -> EventWindow:
    """The loop under the set point that works, with a step at sample 50 recorded beside it."""
    pv, op = pi_loop(working, kp=KP, ti=TI, noise=noise)
    sp = np.where(np.arange(len(working)) < 50, 50.0, 50.0 + step)
    return EventWindow(np.arange(float(len(working))) - 50.0, sp, pv, op, 50)


@pytest.mark.parametrize("rate", [0.02, 0.1, 0.3])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_ramp_in_the_block_is_seen(rate, sign):
    working = 50.0 + sign * np.clip((np.arange(900) - 49) * rate, 0.0, 6.0)
    found = working_setpoint(recorded(working, 6.0 * sign), Settings(KP, TI), 6.0 * sign)
    assert found is not None
    assert found.rate == pytest.approx(rate, rel=0.1)
    np.testing.assert_allclose(found.sp, working, atol=0.15)


def test_a_filter_in_the_block_is_seen():
    k = np.maximum(np.arange(900) - 49, 0)
    assert working_setpoint(recorded(56.0 - 6.0 * np.exp(-k / 40.0), 6.0), Settings(KP, TI), 6.0) is not None


@pytest.mark.parametrize(
    "settings", [Settings(KP, TI), Settings(KP / 3, TI), Settings(KP, TI / 4), Settings(KP, TI, b=0.0)]
)
def test_a_plain_step_is_none_and_wrong_settings_invent_none(settings):
    window = recorded(np.where(np.arange(900) < 50, 50.0, 56.0), 6.0)
    assert working_setpoint(window, settings, 6.0) is None
