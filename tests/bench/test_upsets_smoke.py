"""A few loops of the benchmark `upsets`: what is drawn is what is said, and what happens is recorded."""

from __future__ import annotations

import numpy as np
import pytest

from tests.bench.upsets import HEAD, describe, table_line, watch
from tests.bench.upsets_fleet import BAND_SHARE, PULSE, STEP, UPSETS, draw

SEED = 4
"""Not the benchmark's own."""


@pytest.mark.parametrize("shape", UPSETS)
def test_every_shape_can_be_drawn(shape: str) -> None:
    for number in range(2):
        upset = draw(shape, number, SEED)
        assert upset.loop.process in {"auto", "integrating", "self-regulating"}
        assert 2.9 <= abs(upset.size) / upset.noise <= 201.0
        assert upset.onset > 0.0
        away = np.abs(upset.samples.pv - upset.samples.sp)
        assert away.max() > abs(upset.size) - 5.0 * upset.noise
        assert upset.recovery > 0.0 or np.isnan(upset.over)
        assert 0.0 <= upset.overshoot <= 1.0
        again = draw(shape, number, SEED)
        np.testing.assert_array_equal(again.samples.pv, upset.samples.pv)
    assert BAND_SHARE == 0.05


def test_a_pulse_is_a_disturbance_and_a_step_is_none() -> None:
    pulses, steps = ([watch(shape, k, SEED) for k in range(5)] for shape in (PULSE, STEP))
    assert all(o.records and not o.called for o in pulses if o.counts)
    assert any(o.disturbances and o.size_error < 0.1 for o in pulses)
    assert all(o.records and not o.disturbances for o in steps if o.counts)
    assert table_line(PULSE, pulses).startswith(PULSE)
    assert "recovery" in HEAD
    assert describe(pulses) == ""
