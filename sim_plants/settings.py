"""Settings that a simulated loop comes with: well tuned, and badly in the ways that plants know."""

from dataclasses import replace

import numpy as np

from sim_plants.controllers import Controller, Form
from sim_plants.margins import at_sensitivity, margin
from sim_plants.plants import Plant

TUNINGS = ("good", "sluggish", "rolling", "aggressive", "random")

# A closed loop is not asked to be faster than this many samples.
_RESOLVED = 3
# No loop stays in service that is worse than this; one that only rolls is not nervous on top.
_WORST_MS = dict.fromkeys(TUNINGS, 5.0) | {"rolling": 2.5}
# kp gain ti of SIMC on an integrator is 4; a loop that is only slow stays above the rolling ones.
_NOT_ROLLING = 2.8
_DRAWS = 100


def simc(
    plant: Plant, period: float, derivative: bool = False, form: Form = "standard", ease: float = 1.0
) -> Controller:
    """PI, or PID where `derivative` is set on an integrator, by SIMC.

    The closed-loop time is `ease` times the dead time, or three periods [s] where that is longer.

    References
    ----------
    S. Skogestad, J. Process Control 13 (2003) 291-309, table 1 and section 2 (half rule).
    """
    dead_time, lag = plant.half_rule()
    td = lag if derivative and plant.integrating else 0.0
    if plant.integrating and not td:  # no lag retained: half of the largest is dead time too
        dead_time = plant.t0 - max(plant.lags, default=0.0) / 2
    tight = ease * max(dead_time, _RESOLVED * period) + dead_time
    if plant.integrating:
        kp, ti = 1 / (plant.gain * tight), 4 * tight
    else:
        kp, ti = lag / (plant.gain * tight), min(lag, 4 * tight)
    if td and form != "series":  # the rule is for the series form
        factor = 1 + td / ti
        return Controller(kp * factor, ti * factor, td / factor, form=form)
    return Controller(kp, ti, td, form=form)


def robust_simc(
    plant: Plant, period: float, derivative: bool = False, form: Form = "standard", ms: float = 2.0
) -> Controller:
    """SIMC settings slowed down until the peak sensitivity, filter and hold included, is at most `ms`.

    The rule's own sensitivity holds for a vanishing derivative filter; one of a tenth raises it.
    """
    for ease in np.geomspace(1.0, 10.0, 40):
        settings = simc(plant, period, derivative, form, float(ease))
        if margin(plant, settings, period).ms <= ms:
            break
    return settings


def draw(rng: np.random.Generator, plant: Plant, period: float, base: Controller, tuning: str) -> Controller:
    """Draw settings of a loop that once had `base`, stable and below Ms = 5.

    Parameters
    ----------
    rng : numpy.random.Generator
        Where chance comes from.
    plant, period, base : Plant, float, Controller
        The loop [s].
    tuning : {'good', 'sluggish', 'rolling', 'aggressive', 'random'}
        What has become of it. Rolling: too much integral action for its gain, on an integrator.

    Raises
    ------
    ValueError
        If `tuning` is none of these, or no stable settings turn up.
    """
    if tuning not in TUNINGS:
        raise ValueError(f"tuning: {tuning!r}, expected one of {', '.join(TUNINGS)}")
    for _ in range(_DRAWS):
        trial = _detuned(rng, plant, period, base, tuning)
        result = margin(plant, trial, period)
        if result.stable and result.ms <= _WORST_MS[tuning]:
            return trial
    raise ValueError(f"tuning: {tuning!r}, expected one that is stable for {plant}")


def _detuned(
    rng: np.random.Generator, plant: Plant, period: float, base: Controller, tuning: str
) -> Controller:
    def times(low: float, high: float) -> float:
        return float(np.exp(rng.uniform(np.log(low), np.log(high))))

    def scaled(kp: float, ti: float) -> Controller:
        return replace(base, kp=base.kp * kp, ti=base.ti * ti)

    if tuning == "good":
        return scaled(times(0.9, 1.05), 1.0)
    if tuning == "sluggish":
        slow = scaled(times(0.13, 0.45), times(1.0, 5.0))
        least = _NOT_ROLLING / (plant.gain * slow.kp) if plant.integrating else 0.0
        return replace(slow, ti=max(slow.ti, least))
    if tuning == "rolling":
        weak = scaled(times(0.15, 0.4), 1.0)
        return replace(weak, ti=times(0.4, 1.3) / (plant.gain * weak.kp))
    if tuning == "aggressive":
        return at_sensitivity(plant, scaled(1.0, times(0.5, 1.0)), period, float(rng.uniform(3.0, 4.2)))
    return scaled(times(0.13, 2.2), times(0.4, 5.0))
