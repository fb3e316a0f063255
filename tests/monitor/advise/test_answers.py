"""Responses today and after, with the band of the models that the evidence allows."""

from __future__ import annotations

import numpy as np
import pytest

from monitor.advise.answers import answers
from monitor.advise.region import uncertain_models
from monitor.contract.loops import Loop
from monitor.identify.fit import Fit
from tuners.curves import step_curves
from tuners.settings import Settings

LOOP = Loop(name="LIC-101", kp=2.0, ti=200.0)
NEW = Settings(3.0, 150.0)


def fit(spread: float = 0.05, process: str = "integrating") -> Fit:
    return Fit(
        process=process, gain=0.01 if process == "integrating" else 1.0, lag=20.0, dead_time=10.0, lag2=0.0,
        scatter=np.diag([spread**2, (40 * spread) ** 2, (20 * spread) ** 2]), floor=np.zeros(3), quality=0.99,
        log_likelihood=0.0, sigma=0.01,
    )  # fmt: skip


def test_both_kinds_of_step_today_and_after() -> None:
    setpoint, load = answers(LOOP, fit(), 1.0, NEW)
    assert (setpoint.kind, load.kind) == ("setpoint", "load")
    for found in (setpoint, load):
        assert found.today.shape == found.new.shape == (3, len(found.time))
        for three in (found.today, found.new):
            assert (three[1] <= three[0] + 1e-12).all()
            assert (three[0] <= three[2] + 1e-12).all()
    assert setpoint.today[0, -1] == pytest.approx(1.0, abs=0.05)
    assert np.abs(load.new[0]).max() < np.abs(load.today[0]).max()


def test_the_band_is_that_of_the_region_and_shrinks_with_it() -> None:
    """The ends of the region span what all of its models span, nearly; none of them lies far outside."""
    found = answers(LOOP, fit(), 1.0, NEW)[0]
    every = step_curves(uncertain_models(fit(), 1.0), NEW, "setpoint", found.time)
    width = (every.max(axis=0) - every.min(axis=0)).max()
    assert (found.new[2] - found.new[1]).max() > 0.7 * width
    narrow = answers(LOOP, fit(0.005), 1.0, NEW)[0]
    assert (narrow.new[2] - narrow.new[1]).max() < 0.3 * width


def test_settings_that_are_not_known_have_no_curve() -> None:
    found = answers(LOOP, fit(), 1.0, None)[0]
    assert np.isnan(found.new).all()
    assert np.isfinite(found.today).all()
    found = answers(Loop(name="LIC-101"), fit(), 1.0, NEW)[0]
    assert np.isnan(found.today).all()
    assert answers(Loop(name="LIC-101"), fit(), 1.0, None) == ()


def test_a_loop_that_is_unstable_on_some_model_has_no_band() -> None:
    found = answers(Loop(name="LIC-101", kp=9.5, ti=400.0), fit(0.2), 1.0, NEW)[1]
    assert np.isnan(found.today[1:]).all()
    assert np.isfinite(found.new).all()


def test_a_self_regulating_process_is_shown_as_well() -> None:
    found = answers(
        Loop(name="TIC-1", kp=1.0, ti=20.0), fit(process="self-regulating"), 1.0, Settings(0.8, 18.0)
    )[0]
    assert np.isfinite(found.today).all()
    assert found.new[0, -1] == pytest.approx(1.0, abs=0.05)


def test_a_level_that_rolls_is_seen_to_its_end() -> None:
    """Its period goes with the integral time, not with a T0 of seconds."""
    quick = Fit(
        process="integrating", gain=0.0004, lag=2.0, dead_time=2.0, lag2=0.0, scatter=np.diag([0.01**2, 1.0, 1.0]),
        floor=np.zeros(3), quality=0.99, log_likelihood=0.0, sigma=0.01,
    )  # fmt: skip
    found = answers(Loop(name="LIC-305", kp=6.7, ti=290.0), quick, 10.0, None)[0]
    assert found.time[-1] > 5 * 290.0
    assert found.today[0, -1] == pytest.approx(1.0, abs=0.05)
    assert found.today[0].max() > 1.2
