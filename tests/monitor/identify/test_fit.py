"""Fits of several events together: combined, contradictory, and which kind of process."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from monitor.identify.fit import combine, contradictory, decide
from tests.support.fits import make_fit
from tuners.models import SELF_REGULATING


def test_intervals_are_in_order_and_not_below_zero():
    """For either sign of gain low <= value <= high; times are cut at 0; T0 bounds its parts."""
    for gain in (0.05, -0.05):
        fit = make_fit(gain=gain, lag=0.1, dead_time=0.2, sd=(0.3, 5.0, 5.0))
        for name in ("gain", "lag", "dead_time", "t0"):
            low, high = fit.interval(name)
            assert low <= getattr(fit, name) <= high, name
            if name != "gain":
                assert low >= 0
        assert fit.interval("lag")[1] <= fit.interval("t0")[1]


def test_combining_one_is_that_one():
    """One event: the fit itself."""
    fit = make_fit()
    assert combine([fit]) is fit


def test_combining_lies_between_and_is_sharper():
    """The information-weighted mean: nearer to the better known, sharper than each; the floor stays."""
    sharp, blunt = make_fit(gain=0.050, sd=(0.01, 0.1, 0.1)), make_fit(gain=0.056, sd=(0.1, 1.0, 1.0))
    joint = combine([sharp, blunt])
    assert 0.050 < joint.gain < 0.0515
    assert joint.scatter[0, 0] < min(sharp.cov[0, 0], blunt.cov[0, 0])
    np.testing.assert_allclose(joint.floor, sharp.floor)
    again = combine([blunt, sharp])
    assert again.gain == pytest.approx(joint.gain, rel=1e-12)


def test_a_poor_event_takes_nothing_from_a_good_one():
    """However little its shape is known, the mismatch that is held to be possible stays that of the good one."""
    good = make_fit(sd=(0.01, 0.1, 0.1))
    poor = replace(make_fit(sd=(0.5, 5.0, 5.0)), floor=100.0 * good.floor)
    np.testing.assert_array_less(combine([good, poor]).floor, 1.1 * good.floor)


def test_combining_keeps_the_sign():
    """Negative gains stay negative."""
    assert combine([make_fit(gain=-0.05), make_fit(gain=-0.06)]).gain < 0


def test_combining_half_a_second_lag_counts_as_dead_time():
    """Two fits that differ only in how a rounding is split up between lags and dead time are one process."""
    sharp = make_fit(process=SELF_REGULATING, lag=20.0, dead_time=4.0, lag2=2.0)
    other = make_fit(process=SELF_REGULATING, lag=19.0, dead_time=3.0, lag2=4.0)
    joint = combine([sharp, other])
    assert joint.lag + joint.lag2 / 2 == pytest.approx(21.0)
    assert joint.dead_time + joint.lag2 / 2 == pytest.approx(5.0)
    assert joint.valley is None


def test_many_events_do_not_beat_the_mismatch():
    """However many events, the gain's standard deviation does not fall below the floor of 1 %."""
    joint = combine([make_fit() for _ in range(50)])
    assert math.sqrt(joint.cov[0, 0]) >= 0.01


def test_contradictory_events():
    """Gains that differ beyond chance and by more than a fifth, or in sign."""
    agree = [make_fit(gain=0.05), make_fit(gain=0.052)]
    assert not contradictory(agree, combine(agree))
    differ = [make_fit(gain=0.05), make_fit(gain=0.10)]
    assert contradictory(differ, combine(differ))
    vague = [make_fit(gain=0.05, sd=(0.3, 1, 1)), make_fit(gain=0.10, sd=(0.3, 1, 1))]
    assert not contradictory(vague, combine(vague))
    opposite = [make_fit(gain=0.05), make_fit(gain=-0.05)]
    assert contradictory(opposite, opposite[0])


def test_decide():
    """The better fit wins, beyond doubt only by a margin; alone it wins; of nothing nothing is said."""
    one, two = make_fit(log_likelihood=100.0), make_fit(process=SELF_REGULATING, log_likelihood=99.0)
    assert decide([], 100.0) == (None, False)
    assert decide([one], 100.0) == (one, True)
    assert decide([two, one], 100.0) == (one, False)
    assert decide([replace(two, log_likelihood=120.0), one], 100.0)[1]
    assert decide([replace(two, log_likelihood=97.0), one], 100.0) == (one, True)


def test_a_long_lag_is_no_reason_for_doubt():
    """Where a self-regulating process would be tuned as an integrating one, and explains no more, it is called that."""
    one = make_fit(log_likelihood=100.0)
    slow = make_fit(process=SELF_REGULATING, lag=40.0, log_likelihood=103.0)
    likelier = replace(slow, log_likelihood=107.0)
    assert decide([one, slow], 1e9) == (one, True)
    assert decide([one, replace(slow, lag=20.0)], 1e9)[1] is False
    assert decide([one, likelier], 1e9) == (likelier, True)


def test_likelihoods_are_compared_over_the_points_of_the_poorer_one():
    """Twice as many independent points of equal variance are no better fit."""
    one = replace(make_fit(log_likelihood=100.0), n_eff=50.0)
    two = replace(make_fit(process=SELF_REGULATING, log_likelihood=200.0), n_eff=100.0)
    assert decide([one, two], 1e9)[1] is False
