"""The indirect fit: which settings explain OP, and a model without the bias of noise that goes round the loop."""

from __future__ import annotations

import numpy as np
import pytest

from monitor.contract.loops import Loop
from monitor.contract.samples import Samples
from monitor.detect.detector import Detector
from monitor.detect.event import EventWindow
from monitor.identify.direct import fit_window
from monitor.identify.fit import INDIRECT
from monitor.identify.indirect import LEAST_OP_EXPLAINED, indirect_fit, op_explained
from tests.support.detection import events_of
from tests.support.plants import pi_loop, times
from tuners.models import INTEGRATING
from tuners.settings import Settings

KP, TI = 2.0, 40.0
OWN = Settings(KP, TI)


def stepped(noise: float, seed: int, n: int = 700) -> EventWindow:
    """A set-point step of the tests' own loop: gain 0.05, four samples of dead time."""
    sp = np.full(n, 50.0)
    sp[200:] += 4.0
    pv, op = pi_loop(sp, kp=KP, ti=TI, noise=noise, seed=seed)
    detector = Detector([Loop(name="L")])
    found = detector.run(Samples.of(0, times(n), sp, pv, op))
    (event,) = events_of(found + detector.flush())
    return event.window


@pytest.mark.parametrize(
    ("settings", "share"),
    [(OWN, 1.0), (Settings(KP, 2 * TI), None), (Settings(2 * KP, TI), None), (Settings(-KP, TI), None)],
)
def test_only_its_own_settings_explain_op(settings, share):
    """All of it where they are right; with others less than is asked of them."""
    found = op_explained(stepped(0.05, 1), settings, 1.0)
    if share is None:
        assert found < LEAST_OP_EXPLAINED
    else:
        assert found == pytest.approx(share, abs=1e-6)


def test_the_fit_is_exact_without_noise():
    window = stepped(0.0, 0)
    start = fit_window(window, INTEGRATING)
    assert start is not None
    fit = indirect_fit(window, 1.0, OWN, start)
    assert fit is not None
    assert fit.method == INDIRECT
    assert fit.gain == pytest.approx(0.05, rel=1e-3)
    assert fit.t0 == pytest.approx(4.0, abs=0.05)


def test_noise_that_goes_round_the_loop_does_not_shorten_the_dead_time():
    """On average of many noisy steps T0 is the true one, and the gain within its interval."""
    fits = []
    for seed in range(12):
        window = stepped(0.15, seed)
        start = fit_window(window, INTEGRATING)
        assert start is not None
        fit = indirect_fit(window, 1.0, OWN, start)
        assert fit is not None
        fits.append(fit)
    assert np.mean([f.t0 for f in fits]) == pytest.approx(4.0, abs=0.35)
    assert np.mean([f.gain for f in fits]) == pytest.approx(0.05, rel=0.03)
    covered = [abs(np.log(f.gain / 0.05)) < 1.96 * np.sqrt(f.cov[0, 0]) for f in fits]
    assert sum(covered) >= 10


def test_a_window_off_the_grid_is_not_simulated():
    """Samples between the scans: no controller can be simulated on them."""
    window = stepped(0.0, 0)
    start = fit_window(window, INTEGRATING)
    assert start is not None
    assert indirect_fit(window, 1.7, OWN, start) is None
    assert indirect_fit(window, 0.0, OWN, start) is None
