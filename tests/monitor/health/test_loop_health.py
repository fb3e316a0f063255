"""A loop's figures: shares of time, nothing where nothing is known, numbers whatever comes in."""

from __future__ import annotations

import math
from dataclasses import asdict, replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from monitor.contract.loops import Loop
from monitor.detect.detector import Detector
from monitor.health.loop_health import Health
from tests.monitor.health.tools import health, look, mixed, noise, run, samples_of

WEEK = 7 * 86400


def test_nothing_is_known_of_a_loop_without_samples():
    """And of one with a single sample."""
    assert look(Detector([Loop(name="L")])) == Health()
    assert health(50.0, 50.0, np.full(1, 30.0)) == Health()


@settings(max_examples=10)
@given(st.floats(-3, 3), st.floats(-1, 1))
def test_the_unit_of_pv_does_not_matter(power, shift):
    """Figures in PV scale, the others stay."""
    a, b = 10.0**power, 100.0 * shift
    samples = mixed()
    scaled = replace(samples, sp=a * samples.sp + b, pv=a * samples.pv + b)
    one, other = asdict(look(run(samples))), asdict(look(run(scaled)))
    for figures in (one, other):
        figures.pop("signs")  # of blocks, which are looked at elsewhere
        figures.update(figures.pop("regulation") or {"error_sd": None})
    for name in ("offset", "noise", "quantum", "mean_abs_e", "error_sd"):
        one[name] = None if one[name] is None else a * one[name]
    for name, value in one.items():
        if value is None or isinstance(value, bool):
            assert other[name] == value, name
        else:
            assert other[name] == pytest.approx(
                value, rel=1e-3, abs=1e-3 * a if name == "offset" else 1e-3
            ), name


def assert_finite(record: Any, name: str = "health") -> None:
    """No number of a record, however deep it lies, is NaN or infinite."""
    if record.dtype.names is None:
        assert np.isfinite(record).all(), name
    for inner in record.dtype.names or ():
        assert_finite(record[inner], f"{name}.{inner}")


@settings(max_examples=30)
@given(
    st.integers(0, 2**31),
    st.sampled_from([0.0, 1e-300, 1e-9, 1.0, 1e9, 9e29]),
    st.sampled_from([0.0, 1.0, 1e29]),
    st.sampled_from(["noise", "constant", "walk", "spike", "wave"]),
)
def test_figures_are_numbers_whatever_comes_in(seed, scale, level, kind):
    """No NaN or infinity in the sums, all figures finite, shares between 0 and 1."""
    rng = np.random.default_rng(seed)
    n = 700
    x = {
        "noise": rng.normal(size=n),
        "constant": np.zeros(n),
        "walk": np.cumsum(rng.normal(size=n)),
        "spike": (np.arange(n) == 300) * 1.0,
        "wave": np.sin(np.arange(n) / 3),
    }[kind]
    pv = np.clip(level + scale * x / max(1.0, float(np.abs(x).max())), -9.9e29, 9.9e29)
    sp = np.where(rng.random(n) < 0.01, level + scale, level)
    auto = rng.random() < 0.5 or rng.random(n) > 0.05
    detector = run(samples_of(sp, pv, np.clip(-pv, -9e29, 9e29), auto, time=np.cumsum(rng.integers(1, 3, n))))
    assert_finite(detector.health)
    found = asdict(look(detector, dead_time=3.0))
    found.pop("signs")
    assert all(v is None or math.isfinite(v) for v in found.values())
    shares = (
        "coverage manual saturation oscillation_regularity stiction harris compression held sp_moving".split()
    )
    assert all(found[n] is None or 0 <= found[n] <= 1 for n in shares)


def test_recent_weeks_count():
    """A loop in manual for a week, two months ago, is not called one that is in manual for a third of the time."""
    period = 600.0
    n = round(9 * WEEK / period)
    auto = np.arange(n) > WEEK / period
    assert health(50.0, 50 + noise(n), 30 - noise(n), auto, period=period).manual == pytest.approx(
        0.0, abs=0.05
    )
    late = np.arange(n) < n - WEEK / period
    manual = health(50.0, 50 + noise(n), 30 - noise(n), late, period=period).manual
    assert manual is not None
    assert manual > 0.15
