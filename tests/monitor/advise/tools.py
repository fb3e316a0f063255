"""Advice as the tests here ask for it."""

from __future__ import annotations

from typing import Any

from monitor.advise.evidence import NO_DOUBT, Evidence
from monitor.advise.suggestion import Advice, Withheld, advise
from monitor.assess.reference import model_of, settings_of, with_hold_delay
from monitor.contract.loops import Loop
from monitor.identify.fit import Fit
from tests.support.fits import make_fit
from tuners.robustness import peak_sensitivity

PERIOD = 0.5


def asked(
    loop: Loop, fit: Fit | None = None, noise: float = 0.01, evidence: Evidence = NO_DOUBT
) -> Advice | Withheld:
    fit = make_fit() if fit is None else fit
    today = settings_of(loop)
    ms = None if today is None else float(peak_sensitivity(with_hold_delay(model_of(fit), PERIOD), today))
    return advise(loop, fit, noise, PERIOD, ms, evidence)


def given_advice(*args: Any, **facts: Any) -> Advice:
    advice = asked(*args, **facts)
    assert isinstance(advice, Advice), advice
    return advice


def sluggish(**facts: Any) -> Loop:
    return Loop(**({"name": "L", "kp": 0.6, "ti": 200.0} | facts))


def product(advice: Advice, gain: float = 0.05) -> float:
    standard = advice.aim.to("standard")
    return float(standard.kp * gain * standard.ti)
