"""Upsets as PV shows them: measured in noise against the same loop without it."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from monitor.assess.upset import Upset, measured
from monitor.detect.event import ClosedEvent
from tests.support.detection import detected, loads_of
from tests.support.plants import Samples, pi_loop, times

ONSET = 700
"""Sample of the upset's begin."""


def pulse(k: int) -> float:
    return 8.0 * (ONSET <= k < ONSET + 25)


def half_sine(k: int) -> float:
    return 8.0 * math.sin(math.pi * (k - ONSET) / 80) if ONSET <= k < ONSET + 80 else 0.0


def several(k: int) -> float:
    return 6.0 * (k >= ONSET) - 9.0 * (k >= ONSET + 40)


def upset_loop(
    load: Callable[[int], float], noise: float, seed: int = 1, n: int = 1500, **facts: float
) -> Samples:
    sp = np.full(n, 50.0)
    pv, op = pi_loop(sp, noise=noise, seed=seed, load=load, **facts)
    return Samples.of(0, times(n), sp, pv, op)


def suspected(samples: Samples) -> ClosedEvent:
    (event,) = loads_of(detected(samples)[1])
    return event


def of_pure(load: Callable[[int], float], **facts: float) -> tuple[float, float]:
    """Size [PV], and time from 1 % of it until PV stays within 5 % [s], without noise."""
    pv = upset_loop(load, 0.0, **facts).pv - 50.0
    size = float(pv[np.argmax(np.abs(pv))])
    begun = np.flatnonzero(np.abs(pv) > 0.01 * abs(size))[0]
    return size, float(np.flatnonzero(np.abs(pv) > 0.05 * abs(size))[-1] + 1 - begun)


@pytest.mark.parametrize("load", [pulse, half_sine, several])
@pytest.mark.parametrize("sd", [8.0, 20.0, 100.0])
def test_size_and_recovery_are_those_without_noise(load: Callable[[int], float], sd: float) -> None:
    """The size within 10 % in the median of some noises; the recovery, where noise leaves it to be seen, too."""
    size, recovery = of_pure(load)
    found = [measured(suspected(upset_loop(load, abs(size) / sd, seed))) for seed in range(4)]
    seen = [u for u in found if u is not None]
    assert len(seen) >= 3
    assert np.median([u.size for u in seen]) == pytest.approx(size, rel=0.1)
    if sd > 50.0:
        assert np.median([u.recovery or math.nan for u in seen]) == pytest.approx(recovery, rel=0.1)


def test_what_rings_is_told_its_damping() -> None:
    """A loop near instability after a pulse: the damping of its slowest mode, and how far it went beyond."""
    quick = {"kp": 4.2, "ti": 40.0}
    pure = measured(suspected(upset_loop(pulse, 1e-4, **quick)))
    seen = measured(suspected(upset_loop(pulse, 0.02, **quick)))
    assert pure is not None
    assert seen is not None
    assert pure.damping is not None
    assert pure.damping < 0.2
    assert seen.damping == pytest.approx(pure.damping, abs=0.03)
    assert seen.overshoot == pytest.approx(pure.overshoot, rel=0.1)
    assert seen.rings


def test_what_does_not_stand_out_is_none() -> None:
    """An excursion of less than five standard deviations of noise, or no larger than what went before it."""
    event = suspected(upset_loop(pulse, 0.02))
    seen = measured(event)
    assert seen is not None
    assert measured(replace(event, noise=abs(seen.size) / 4.5)) is None
    w, quiet = event.window, event.window.before // 2
    waves = np.where(np.arange(len(w)) < quiet, 0.8 * seen.size * np.sin(np.arange(len(w)) / 5.0), 0.0)
    assert measured(replace(event, window=replace(w, pv=w.pv + waves))) is None


def test_a_swing_that_goes_on_is_an_oscillation() -> None:
    event = suspected(upset_loop(pulse, 0.02))
    w = event.window
    swing = np.where(w.time > 0.0, np.sin(w.time / 6.0), 0.0)
    assert measured(replace(event, window=replace(w, pv=w.sp + 2.0 * swing))) is None


def test_what_is_cut_short_is_measured_as_far_as_seen() -> None:
    """Off at the end of the data: the size so far, and no recovery."""
    seen = measured(suspected(upset_loop(pulse, 0.02, n=ONSET + 30)))
    assert seen == Upset(seen.size, seen.onset, None, None, None) if seen else False


def test_without_noise_and_in_steps() -> None:
    """A simulated signal without noise, and one seen through a coarse transmitter."""
    size, recovery = of_pure(pulse)
    samples = upset_loop(pulse, 0.0)
    for pv, rel in ((samples.pv, 0.01), (np.round(samples.pv / 0.1) * 0.1, 0.05)):
        seen = measured(suspected(replace(samples, pv=pv)))
        assert seen is not None
        assert seen.size == pytest.approx(size, rel=rel)
        assert seen.recovery == pytest.approx(recovery, rel=0.1)
