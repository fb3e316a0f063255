"""What a historian drew between the values that it kept: the model is still right, its intervals are wider."""

from __future__ import annotations

import numpy as np
import pytest

from monitor.contract.loops import Loop
from monitor.contract.records import INCONCLUSIVE
from monitor.contract.samples import Samples
from tests.bench.health_archive import interpolated, swinging_door
from tests.support.plants import pi_loop, times
from tests.support.runs import run

LOOP = Loop(name="L", process="integrating", kp=1.2, ti=200.0, op_low=0, op_high=100, pv_low=0, pv_high=100)
"""Slow for a gain of 0.01 and a dead time of 10 s."""


def recorded(deviation: float, seed: int = 0, noise: float = 0.04) -> Samples:
    """Two set-point steps as an archive gives them back; without a deviation as they were."""
    sp = np.full(10_000, 50.0)
    sp[2000:6000] += 6.0
    pv, op = pi_loop(sp, kp=1.2, ti=200.0, gain=0.01, dead=10, noise=noise, seed=seed)
    if deviation > 0:
        pv, op = (interpolated(x, swinging_door(x, deviation)) for x in (pv, op))
    return Samples.of(0, times(len(sp)), sp, pv, op)


@pytest.mark.parametrize("deviation", [0.08, 0.12])
@pytest.mark.parametrize("seed", range(2))
def test_a_compressed_loop_is_judged_and_named(deviation, seed):
    """The flag stays, the words say so, the true gain is inside, and nothing is withheld for it alone."""
    engine, seen = run(LOOP, recorded(deviation, seed))
    assert [a.amplitude for a in seen.assessments] == [6.0, -6.0]
    assert all(a.gain_lo < 0.01 < a.gain_hi for a in seen.assessments)
    row = engine.row(0)
    assert "compressed" in row.flags
    assert "the historian compressed these data" in row.reason
    assert "intervals are wider" in row.reason
    assert row.verdict != INCONCLUSIVE


@pytest.mark.parametrize("deviation", [0.2, 0.3])
@pytest.mark.parametrize("seed", range(2))
def test_what_is_left_of_little_is_not_made_much_of(deviation, seed):
    """Where the deviation is a twentieth of the step, the gain comes out too low: no settings beyond safe ones."""
    engine, _ = run(LOOP, recorded(deviation, seed))
    row = engine.row(0)
    assert "compressed" in row.flags
    assert row.verdict == INCONCLUSIVE or row.new_kp is None or row.new_kp < 5.0  # SIMC's, at tc = dead time


def test_its_intervals_are_wider():
    """Than on the data as they were, by the model's mismatch at least."""
    widths = []
    for deviation in (0.0, 0.2):
        _, seen = run(LOOP, recorded(deviation))
        widths.append([a.gain_hi / a.gain_lo for a in seen.assessments])
    assert all(wide > 1.3 * narrow - 0.3 for narrow, wide in zip(*widths, strict=True))
    assert min(widths[1]) > np.exp(2 * 1.96 * 0.02)
