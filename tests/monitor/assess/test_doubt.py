"""How far off a gain may be because process or load are of another kind."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from monitor.assess.doubt import BY_LOAD, LEFT_RATIO, MOST_BY_ERROR, UNDECIDED, gain_doubt
from monitor.contract.loops import Loop
from monitor.identify.misfit import NOTHING_SEEN, NOTHING_UNSEEN, ModelError
from tests.support.fits import make_fit
from tests.support.plants import stepped
from tests.support.runs import run
from tuners.models import INTEGRATING, SELF_REGULATING


def seen(omega: float, bound: float) -> ModelError:
    return ModelError(np.array([omega]), np.array([bound]), np.array([50.0]), NOTHING_UNSEEN)


def test_a_clean_setpoint_step_leaves_none():
    assert gain_doubt(make_fit(0.05, 5.0, 5.0), NOTHING_SEEN, False, False) == 0.0


def test_an_error_of_the_model_is_one_of_its_gain():
    """A tenth of the model at that frequency; never more than leaves something said."""
    fit = make_fit(0.05, 5.0, 5.0)
    size = 0.05 / 0.2 / abs(1 + 0.2j * fit.lag)
    assert math.sqrt(gain_doubt(fit, seen(0.2, 0.1 * size), False, False)) == pytest.approx(0.1)
    assert math.sqrt(gain_doubt(fit, seen(0.2, 9.0 * size), False, False)) == MOST_BY_ERROR


@pytest.mark.parametrize("process", [INTEGRATING, SELF_REGULATING])
def test_the_shape_of_a_load_is_not_known(process):
    fit = make_fit(0.05, 5.0, 20.0, process=process)
    least = math.sqrt(gain_doubt(fit, NOTHING_SEEN, True, False))
    assert least == pytest.approx(BY_LOAD[process])
    assert math.sqrt(gain_doubt(fit, NOTHING_SEEN, True, True)) == pytest.approx(max(least, UNDECIDED))
    left = gain_doubt(replace(fit, leaves_more=True), NOTHING_SEEN, True, False)
    assert math.sqrt(left) == pytest.approx(LEFT_RATIO * least)


def test_what_is_said_of_the_gain_holds_it():
    """The record tells the wider interval; that of the model alone, which settings are kept safe against, stays."""
    _, records = run(Loop(name="L", kp=2.0, ti=40.0), stepped(noise=0.05))
    (record,) = records.assessments
    assert record.gain_lo < 0.05 < record.gain_hi
    fit = replace(make_fit(0.05, 5.0, 5.0), doubt=0.04)
    low, high = fit.told("gain")
    assert low < fit.interval("gain")[0] < fit.interval("gain")[1] < high
    assert fit.told("t0") == fit.interval("t0")
