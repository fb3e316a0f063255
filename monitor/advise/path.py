"""The walk from today's settings to the aim: how far one may go now, and how the rest of the way is foreseen."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from itertools import islice

import numpy as np

from monitor.assess.tuning import LEAST_METHOD_PRODUCT
from tuners.levels import method_product
from tuners.models import IntegratingModel, Model
from tuners.settings import NotRepresentableError, Settings

from .candidates import Limits
from .guards import LOADS_ALONE, MISFIT, NEAR_THE_EDGE, SOFT_RATIO, Guards
from .stages import ORDERS, between, rounded, stages

WAY_SHARES = tuple(k / 20 for k in range(20, 1, -1))
"""Shares of the way, by ratio, that are looked at, from the aim back to today's settings."""
SOFT_SHARES = (1.0, 0.7, 0.4)
"""Shares of a soft step."""
LEAST_STEP_RATIO = 1.05
"""Of gain or a time in today's, below which a step is none."""
UNKNOWN_START_RATIO = 4.0
"""Where today's settings are not known, the way comes from settings so many times gentler than the aim."""
RETREAT_RATIOS = (1.25, 1.6, 2.0, 2.5, 3.2, 4.0, 5.0)
"""Times gentler than an aim that takes gain away, where the model's error asks for more than that."""
LONGER_RATIOS = (10.0, 6.0, 4.0, 2.5, 1.6)
"""Times longer an integral time, for a loop that rolls and whose gain may not be raised."""
WELL_DAMPED_PRODUCT = 4.0
"""Kc K Ti of an integrating loop whose slow swing is damped critically."""
MS_ON_THE_WAY = "Ms on the way would be too high"
NEARLY_THERE = "what is safe to change now is less than 5 % of today's settings"


@dataclass(frozen=True, eq=False, slots=True)
class Way:
    """What may be typed in now, and where it leads."""

    now: Settings
    peaks: tuple[float, float]
    """Its Ms on the model found and on the worst one."""
    stages: list[Settings]
    """``now`` first, the aim last."""
    limited_by: str
    """What keeps the rest back, in words; empty where ``now`` is the aim."""
    soft: bool = False
    """It is a small step that is taken in spite of the model's error."""


def way(limits: Limits, guards: Guards, aim: Settings, peaks: tuple[float, float]) -> Way | str:
    """Return the furthest point of the way to an aim that is safe on the evidence, or say why there is none.

    Gain and times move together, by ratio; where no point of that way is safe, the times first, or the gain first.
    Where the model's error forbids every point, a soft step may be left.

    Parameters
    ----------
    limits, guards
        What each point has to keep to.
    aim
        What the search found; it keeps to the limits.
    peaks
        Ms of the aim on the model found and on the worst one.
    """
    start = guards.today if guards.today is not None else gentler(aim, UNKNOWN_START_RATIO)
    aim, peaks = _retreat(limits, guards, aim) or (aim, peaks)
    guards = replace(guards, aim=aim)
    end, reasons = aim, []
    if guards.lead_withheld and float(aim.td) > 0:
        end, reasons = replace(aim, td=0.0, tf=0.0), [LOADS_ALONE]
    for order in ORDERS:
        on_the_way = (between(start, end, *order(x)) for x in WAY_SHARES)
        points = _distinct(start, (p if p == end else without_rolling(p, guards.model) for p in on_the_way))
        # the end alone first: where it may be typed in, the others are not asked for
        for many in (list(islice(points, count)) for count in (1, None)):
            for point, why in zip(many, guards.refused(many), strict=True):
                found = None if why else _safe(limits, point, aim, peaks)
                if found is not None:
                    return _to(limits, point, found, aim, next(iter(reasons), ""))
                reasons.append(why or MS_ON_THE_WAY)
    damped = without_rolling(start, guards.model)
    for reason, beside, to in (
        ("", _longer_points, damped),
        (MISFIT, _soft_points, aim),
        (NEAR_THE_EDGE, _calmer_points, aim),
    ):
        for point in beside(start, to, guards) if (reason in reasons if reason else damped != start) else ():
            found = _safe(limits, point, aim, peaks)
            if found is not None:
                return replace(_to(limits, point, found, aim, reason or reasons[0]), soft=reason == MISFIT)
    return reasons[0] if reasons else NEARLY_THERE


def _calmer_points(start: Settings, _: Settings, guards: Guards) -> list[Settings]:
    """Return settings beside the way for a loop near instability: longer integral times, then less gain, too."""
    longer = [replace(start, ti=rounded(float(start.ti) * ratio)) for ratio in RETREAT_RATIOS]
    points = list(_distinct(start, [*longer, *(gentler(start, ratio) for ratio in RETREAT_RATIOS)]))
    return [p for p, why in zip(points, guards.refused(points), strict=True) if not why]


def _longer_points(start: Settings, damped: Settings, guards: Guards) -> list[Settings]:
    """Return settings of today's gain and a longer integral time: that of a well ``damped`` swing, then longer ones."""
    longer = (replace(start, ti=rounded(float(start.ti) * ratio)) for ratio in LONGER_RATIOS)
    points = list(_distinct(start, [damped, *longer]))
    return [p for p, why in zip(points, guards.refused(points), strict=True) if not why]


def _to(limits: Limits, now: Settings, peaks: tuple[float, float], aim: Settings, limited_by: str) -> Way:
    """Put a way together."""
    if now == aim:
        return Way(now, peaks, [now], "")
    rest = stages(limits.region, now, aim, limits.loop.ms_max)
    return Way(now, peaks, [now, *rest], limited_by)


def _safe(
    limits: Limits, point: Settings, aim: Settings, peaks: tuple[float, float]
) -> tuple[float, float] | None:
    """Ms of a point on the model found and on the worst one, where it keeps to all limits."""
    found = peaks if point == aim else limits.worst(point)
    return found if limits.kept_by(point, found) else None


def _soft_points(start: Settings, aim: Settings, guards: Guards) -> list[Settings]:
    """Points of the way that are a small step from today's settings, the furthest first."""
    if float(start.td) == 0.0 < float(aim.td):
        aim = replace(aim, td=0.0, tf=0.0)
    gain = abs(math.log(abs(float(aim.kp) / float(start.kp))))
    times = [
        abs(math.log(float(getattr(aim, n)) / float(getattr(start, n))))
        for n in ("ti", "td")
        if 0 < float(getattr(start, n)) < math.inf and 0 < float(getattr(aim, n)) < math.inf
    ]
    longest = max(gain, *times, 1e-9)
    most = min(math.log(SOFT_RATIO) / longest, 1.0)
    points = list(_distinct(start, (between(start, aim, most * x, most * x) for x in SOFT_SHARES)))
    return [p for p, ok in zip(points, guards.soft(points), strict=True) if ok]


def _distinct(start: Settings, points: Iterable[Settings]) -> Iterator[Settings]:
    """Yield the points that are a step away from the start, each once."""
    found: list[Settings] = []
    for point in points:
        if point not in found and is_a_step(start, point):
            found.append(point)
            yield point


def is_a_step(one: Settings, other: Settings) -> bool:
    """Whether two settings differ enough that going from one to the other is worth the while: 5 % somewhere."""
    for name in ("kp", "ti", "td"):
        a, b = abs(float(getattr(one, name))), abs(float(getattr(other, name)))
        if a != b and (
            not (0 < a < math.inf and 0 < b < math.inf) or abs(math.log(b / a)) >= math.log(LEAST_STEP_RATIO)
        ):
            return True
    return False


def _retreat(limits: Limits, guards: Guards, aim: Settings) -> tuple[Settings, tuple[float, float]] | None:
    """Return settings gentler than an aim that takes less gain away than the model's error asks for; else None."""
    today = guards.today
    if today is None or not abs(float(aim.kp)) < abs(float(today.kp)) or not guards.endangered([aim])[0]:
        return None
    many = [gentler(aim, ratio) for ratio in RETREAT_RATIOS]
    for settings, wrong in zip(many, guards.endangered(many), strict=True):
        peaks = None if wrong else limits.worst(settings)
        if peaks is not None and limits.kept_by(settings, peaks):
            return settings, peaks
    return None


def without_rolling(point: Settings, model: Model) -> Settings:
    """Return settings with an integral time long enough for their gain, where an integrating loop would roll with them.

    The gain that is safe to type in now may be too little for the integral time of the aim: the damping of the slow
    swing is ``sqrt(Kc K Ti)/2`` (S. Skogestad, J. Process Control 13 (2003) 291-309, eq. 18), 1 from a product of 4.
    """
    if not isinstance(model, IntegratingModel) or not math.isfinite(float(point.ti)):
        return point
    try:
        product = float(np.ravel(method_product(model, point))[0])
    except NotRepresentableError:
        return point
    if not 0.0 < product < LEAST_METHOD_PRODUCT:
        return point
    return replace(point, ti=rounded(float(point.ti) * WELL_DAMPED_PRODUCT / product))


def gentler(settings: Settings, ratio: float) -> Settings:
    """Return settings of so many times less gain, and as many times longer an integral time.

    Examples
    --------
    >>> slower = gentler(Settings(kp=3.0, ti=20.0), 2.0)
    >>> slower.kp, slower.ti
    (1.5, 40.0)
    """
    ti = rounded(float(settings.ti) * ratio)
    return replace(settings, kp=rounded(float(settings.kp) / ratio), ti=ti)
