"""The way from some settings to others, in steps with a look in between."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from tuners.models import Model
from tuners.settings import Settings

from .region import nominal, worst_peaks

STAGE_RATIO = 3.0
"""Factor in gain above which a change is given in stages."""
STAGE_MS_SHARE = 0.99
"""Ms is searched to 1 %: a stage keeps this much below what it may have."""

ORDERS: list[Callable[[float], tuple[float, float]]] = [
    lambda x: (x, x),  # together
    lambda x: (x, 1.0),  # times first
    lambda x: (x, 1.0 if x == 1.0 else 0.0),  # gain first
]
"""Ways to go: share of the gain's change and of the times' change, for the share of the way."""


def stages(region: Model, today: Settings, new: Settings, ms_max: float) -> list[Settings]:
    """Return steps of at most a factor of three in gain, none of them more dangerous than it must be.

    Gain and times may move together, or the times first, or the gain first (an integrating loop can be *less* stable
    half-way when they move separately, and more). Of the ways on which no stage exceeds ``ms_max``, or today's Ms if
    that is higher, on the model found, the one is taken whose worst stage is safest for the worst model of the
    region. One step where there is no such way.

    Parameters
    ----------
    region
        Models that the evidence allows, fields (M, 1); the first is the one found.
    today, new
        Both in one form.
    ms_max
        Highest Ms wanted [-].
    """
    n = max(math.ceil(abs(math.log(abs(float(new.kp) / float(today.kp)))) / math.log(STAGE_RATIO) - 1e-9), 1)
    if n == 1:
        return [new]
    ways = [[between(today, new, *order(k / n)) for k in range(1, n + 1)] for order in ORDERS]
    every = stacked([today, *(stage for way in ways for stage in way[:-1])])
    at_fit, worst = (worst_peaks(models, every) for models in (nominal(region), region))
    allowed = max(ms_max, at_fit[0])
    peaks = [np.max(p[1:].reshape(len(ways), n - 1), axis=1) for p in (at_fit, worst)]
    order = sorted(range(len(ways)), key=lambda k: (peaks[1][k], peaks[0][k]))
    safe = [k for k in order if peaks[0][k] <= STAGE_MS_SHARE * allowed]
    return ways[safe[0]] if safe else [new]


def stacked(settings: list[Settings]) -> Settings:
    """Return one Settings with fields (T,), without weights."""
    columns = {n: np.array([float(getattr(s, n)) for s in settings]) for n in ("kp", "ti", "td", "tf")}
    return Settings(form=settings[0].form, **columns)


def rounded(value: float) -> float:
    """Three significant digits: nobody types more, and the robustness stated is that of what is typed.

    Examples
    --------
    >>> rounded(2.30517)
    2.31
    """
    return float(f"{value:.3g}") if math.isfinite(value) else value


def between(today: Settings, new: Settings, gain_share: float, time_share: float) -> Settings:
    """Return the settings a share of the way, by ratio; a time that is 0 or inf at either end takes the new value.

    Parameters
    ----------
    today, new
        The ends of the way.
    gain_share, time_share
        Share of the gain's change, and of the times'.
    """

    def mix(name: str, share: float) -> float:
        a, b = float(getattr(today, name)), float(getattr(new, name))
        if share == 1.0 or not (0 < abs(a) < math.inf and 0 < abs(b) < math.inf) or a * b < 0:
            return b
        return rounded(a * (b / a) ** share)

    td = mix("td", time_share)
    tf = mix("tf", time_share) if td > 0 else 0.0
    return replace(new, kp=mix("kp", gain_share), ti=mix("ti", time_share), td=td, tf=tf)
