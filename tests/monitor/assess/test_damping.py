"""A response shows its own damping."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from monitor.assess.damping import is_damped, swings
from monitor.detect.event import INTERRUPTED, LOAD_STEP
from tests.support.detection import closed_event


def responding(decay: float, amplitude: float = 4.0, kind: int | None = None, **facts: float):
    """A step whose error swings; ``decay``: of each swing to the next. A load's begins at zero."""
    event = closed_event()
    w, kind = event.window, event.kind if kind is None else kind
    t = np.maximum(w.time, 0.0)
    wave = np.sin(t / 10.0) if kind == LOAD_STEP else np.cos(t / 10.0)
    e = np.where(w.time >= 0.0, amplitude * wave * decay ** (t / (10.0 * np.pi)), 0.0)
    return replace(event, kind=kind, amplitude=amplitude, window=replace(w, pv=w.sp - e), **facts)


@pytest.mark.parametrize("kind", [None, LOAD_STEP])
@pytest.mark.parametrize(("decay", "damped"), [(0.05, True), (0.3, True), (0.5, False), (0.8, False)])
def test_each_swing_is_much_smaller_than_the_one_before(decay, damped, kind):
    assert is_damped(responding(decay, kind=kind, error_sd=0.01)) is damped


def test_what_does_not_show_is_not_known():
    """Noise as large as a tenth of the step; an event that did not come to rest."""
    assert is_damped(responding(0.3, error_sd=0.2)) is None
    assert is_damped(replace(responding(0.3, error_sd=0.01), state=INTERRUPTED)) is None


def test_no_error_no_swing():
    """What stays inside the floor is none; one side alone is one."""
    assert not len(swings(np.array([0.1, -0.1]), 0.2))
    assert list(swings(np.array([0.5, 1.0, 0.3]), 0.2)) == [1.0]
    assert not len(swings(np.array([]), 0.2))
