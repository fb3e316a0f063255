"""The index is of the signal, in any units."""

from __future__ import annotations

from dataclasses import replace

import pytest

from tests.monitor.assess.tools import assessed
from tests.support.plants import stepped


def test_the_index_is_of_the_signal_not_of_the_noise():
    """Three percent of noise over a long window changes CI by less than a tenth."""
    clean, _, _ = assessed(stepped(1500, seed=1))
    noisy, _, _ = assessed(stepped(1500, noise=0.12, seed=1))
    assert clean.ci is not None
    assert noisy.ci == pytest.approx(clean.ci, rel=0.1)


def test_units_do_not_change_a_verdict():
    """Other units of PV and OP, another operating point: CI and Ms the same, gain scaled."""
    samples = stepped(noise=0.03, seed=4)
    other = replace(samples, sp=2.5 * samples.sp - 40, pv=2.5 * samples.pv - 40, op=0.1 * samples.op + 7)
    first, _, _ = assessed(samples)
    second, _, _ = assessed(other, kp=2.0 * 0.1 / 2.5)
    assert second.ci == pytest.approx(first.ci, rel=1e-4)
    assert second.ms == pytest.approx(first.ms, rel=1e-3)
    assert first.gain is not None
    assert second.gain == pytest.approx(first.gain * 25.0, rel=1e-4)
    assert (second.verdict, second.reason) == (first.verdict, first.reason)
