"""A model and a verdict to new settings, or to the reason why there are none.

The reference rule of the loop's own structure, slowed down until it is safe for every model that the evidence
allows, gentle enough on the valve, and within reach of the settings of today.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import product
from typing import Any

import numpy as np

from tuners.models import IntegratingModel, Model, SelfRegulatingModel
from tuners.responses import closed_loop_response
from tuners.robustness import peak_sensitivity
from tuners.settings import NotRepresentableError, Settings

from .identify import INTEGRATING, Array, Fit
from .loops import Loop
from .reference import (
    LOAD,
    RULE,
    SETPOINT,
    closed_loop_time,
    held,
    model_of,
    reduced,
    reference_iae,
    reference_settings,
    reference_structure,
    settings_of,
)

SLOWEST = 64.0
"""The closed-loop time is raised at most by this factor in search of a safe suggestion."""
FURTHEST = 10.0
"""A suggestion changes the gain by at most this factor: the evidence was seen with the settings of today."""
STAGE = 3.0
"""Factor in gain above which a change is given in stages."""
GAIN_WORTH = 0.85
"""A suggestion for speed must bring the predicted error below this share of today's."""
REGION = math.sqrt(7.815)
"""Radius, in sigma, of the 95 % region of three parameters (chi-squared, 3 degrees of freedom)."""


@dataclass(frozen=True, slots=True)
class Advice:
    """Safe new settings and what they will do."""

    rule: str
    settings: Settings
    """In the loop's own form."""
    closed_loop_time: float
    """tc for which they hold [s]."""
    ms: float
    ms_worst: float
    """For the worst model inside the intervals."""
    ci: float | None
    """Predicted; by the loop's own reference."""
    op_noise: float
    """Standard deviation that PV's noise will put on OP [OP]."""
    before: tuple[float, float, float] | None
    """Overshoot [share], IAE of a unit set-point [s] and load step [PV s/OP] predicted for today's settings."""
    after: tuple[float, float, float]
    """The same for the new ones."""
    stages: list[Settings]
    """Settings to go through; the last one is the suggestion."""


@dataclass(frozen=True, slots=True)
class Withheld:
    """No suggestion, and why."""

    reason: str
    fine_as_it_is: bool = False
    """The reason is that nothing is to be gained."""


def advise(
    loop: Loop, form: str, fit: Fit, noise: float, period: float, ms: float | None
) -> Advice | Withheld:
    """Find the fastest settings of the reference rule that are safe, gentle and in reach.

    Parameters
    ----------
    loop
        With the settings of today, where known.
    form
        Canonical form of the loop's controller: ``standard``, ``series``, ``parallel``.
    fit
        Process with its uncertainty; the suggestion holds for all of it.
    noise
        Standard deviation of PV's noise [PV].
    period
        Sample period, for the least closed-loop time and for the noise's way through the controller [s].
    ms
        Peak sensitivity of today's settings on the model, None where not known.
    """
    if loop.objective == "averaging":
        return _averaging(loop, form, fit, noise, period, ms)
    model = model_of(fit)
    structure = reference_structure(loop)
    tc = closed_loop_time(loop, reduced(model, structure), period)
    region = held(_region(fit), period)

    def tried(times: Array) -> _Tried:
        return _try(loop, form, model, structure, region, noise, period, times)

    try:
        coarse = tried(tc * np.geomspace(1.0, SLOWEST, 13))
        if not coarse.fits.any():
            return Withheld(coarse.failing())
        k = int(np.argmax(coarse.fits))
        found = coarse if k == 0 else tried(np.geomspace(coarse.times[k - 1], coarse.times[k], 9)[1:])
    except (ValueError, NotRepresentableError) as error:
        return Withheld(f"no settings of the rule {RULE[structure]} for this model: {error}")
    k = int(np.argmax(found.fits)) if found.fits.any() else len(found.times) - 1
    return _worthwhile(
        loop, form, fit, found.candidates[k], structure, tc, float(found.times[k]), float(found.worst[k]),
        float(found.noises[k]), ms, period,
    )  # fmt: skip


@dataclass(frozen=True, slots=True)
class _Tried:
    """Candidates for some closed-loop times, and which of them keep to all limits. Arrays are (T,)."""

    times: Array
    candidates: list[Settings]
    worst: Array
    """Ms of the worst model."""
    noises: Array
    """Noise on OP [OP]."""
    limits: list[tuple[str, Any]]
    """(what is wrong where the limit is not kept, where it is kept)."""

    @property
    def fits(self) -> Any:
        """Where all limits are kept."""
        return np.all([ok for _, ok in self.limits], axis=0)

    def failing(self) -> str:
        """Say which limits leave nothing over."""
        never = [why for why, ok in self.limits if not ok.any()]
        return "; ".join(never or [why for why, ok in self.limits if not ok.all()])


def _try(
    loop: Loop, form: str, model: Model, structure: str, region: Model, noise: float, period: float, times: Array
) -> _Tried:  # fmt: skip
    """Hold the rule's settings for these closed-loop times against every limit."""
    candidates = [_candidate(loop, form, model, structure, float(time)) for time in times]
    many = _stack(candidates)
    noises = op_noise(many, noise, period)
    worst = np.max(peak_sensitivity(region, many), axis=0)
    limits: list[tuple[str, Any]] = [
        (f"Ms stays above {loop.ms_max:g} for the worst model inside the intervals", worst <= loop.ms_max)
    ]
    if loop.op_span is not None:
        allowed = loop.op_noise_max / 100.0 * loop.op_span
        limits.append((f"PV's noise would put more than {loop.op_noise_max:g} % on OP", noises <= allowed))
    if loop.kp is not None:
        ratio = np.abs(np.asarray(many.kp)[0] / loop.kp)
        limits.append((f"the gain would change more than {FURTHEST:g} times at once", _within(ratio)))
    return _Tried(times, candidates, worst, noises, limits)


def _averaging(
    loop: Loop, form: str, fit: Fit, noise: float, period: float, ms: float | None
) -> Advice | Withheld:
    """Suggest for a surge vessel the gain that its load and room ask for, and as much integral as damping allows.

    ``|Kc| = max_load/max_deviation`` (today's where these are not known), ``Ti = 4/(Kc K)``: damping 1 for a
    small dead time.
    """
    model, today = model_of(fit), settings_of(loop, form)
    if not isinstance(model, IntegratingModel):
        return Withheld("the averaging rule is for integrating processes")
    if loop.max_load is not None and loop.max_deviation is not None:
        kp = _rounded(math.copysign(loop.max_load / loop.max_deviation, fit.gain))
    elif today is not None:
        kp = float(today.kp)
    else:
        return Withheld("the averaging rule needs max_load and max_deviation, or today's settings")
    new = Settings(kp, _rounded(4.0 / (kp * fit.gain)), 0.0, 0.0, form, loop.b, loop.c)
    worst = float(np.max(peak_sensitivity(held(_region(fit), period), new)))
    if worst > loop.ms_max:
        return Withheld(f"Ms stays above {loop.ms_max:g} for the worst model inside the intervals")
    sampled = held(model, period)
    stages = [new] if today is None else _stages(sampled, today, new, max(loop.ms_max, ms or 0.0))
    return Advice(
        "averaging",
        new,
        float(new.ti) / 4.0,
        float(peak_sensitivity(sampled, new)),
        worst,
        None,
        float(op_noise(new, noise, period)[0]),
        None if today is None else _predicted(model, today),
        _predicted(model, new),
        stages,
    )


def _within(ratio: Array) -> Any:
    return (ratio <= FURTHEST) & (ratio >= 1.0 / FURTHEST)


def _worthwhile(
    loop: Loop, form: str, fit: Fit, new: Settings, structure: str, tc: float, time: float, worst: float,
    noise: float, ms: float | None, period: float,
) -> Advice | Withheld:  # fmt: skip
    """Predict what the settings bring; withhold them where they bring nothing."""
    model = model_of(fit)
    after, today = _predicted(model, new), settings_of(loop, form)
    before = None if today is None else _predicted(model, today)
    kind, error = (LOAD, 2) if loop.objective == LOAD else (SETPOINT, 1)
    if before is not None and ms is not None and ms <= 1.25 * loop.ms_max:
        wanted = {SETPOINT: (1,), LOAD: (2,)}.get(loop.objective, (1, 2))
        if all(after[k] > GAIN_WORTH * before[k] for k in wanted):
            return Withheld(
                "as tight as the evidence allows: no safe settings are 15 % better", fine_as_it_is=True
            )
    try:
        best = reference_iae(kind, 1.0, model, structure, tc, loop.b, loop.c)
    except ValueError:
        best = math.nan
    ci = float(best / after[error]) if math.isfinite(best) and after[error] > 0 else None
    sampled = held(model, period)
    ms_new = float(peak_sensitivity(sampled, new))
    stages = [new] if today is None else _stages(sampled, today, new, max(loop.ms_max, ms or 0.0))
    return Advice(RULE[structure], new, time, ms_new, worst, ci, noise, before, after, stages)


def _predicted(model: Model, settings: Settings) -> tuple[float, float, float]:
    """Overshoot [share] and IAE of a unit set-point [s] and load step [PV s/OP] on the model."""
    setpoint = closed_loop_response(model, settings, kind=SETPOINT)
    load = closed_loop_response(model, settings, kind=LOAD)
    return float(setpoint.overshoot), float(setpoint.iae), float(load.iae)


def _candidate(loop: Loop, form: str, model: Model, structure: str, tc: float) -> Settings:
    """Return the rule's settings in the loop's form with its filter ratio and weights, rounded as one types them."""
    rule = reference_settings(model, structure, tc).to(form)
    td = _rounded(float(rule.td))
    ratio = loop.td / loop.filter_time if loop.td > 0 and loop.filter_time > 0 else 10.0
    return Settings(
        _rounded(float(rule.kp)),
        _rounded(float(rule.ti)),
        td,
        td / ratio if td > 0 else 0.0,
        form,
        loop.b,
        loop.c,
    )


def _rounded(value: float) -> float:
    """Three significant digits: nobody types more, and the robustness stated is that of what is typed."""
    return float(f"{value:.3g}") if math.isfinite(value) else value


def _stack(settings: list[Settings]) -> Settings:
    """Return one Settings with fields of shape (1, T), to be crossed with models of shape (M, 1)."""
    columns = {n: np.array([[float(getattr(s, n)) for s in settings]]) for n in ("kp", "ti", "td", "tf")}
    return Settings(form=settings[0].form, **columns)


def _region(fit: Fit) -> Model:
    """Return models on the surface of the fit's 95 % region, fields of shape (M, 1).

    The region lies in (ln |gain|, lag, dead time) with the joint covariance: its centre, axes, edges, corners, and
    the axes of gain and dead time at the lag found. Where it reaches below a time of 0 it is cut: a point is drawn
    back towards the centre until both times are allowed. (Setting the lag alone to 0 would keep the long dead
    time that only goes with a negative lag.)
    """
    values, vectors = np.linalg.eigh(fit.cov)
    axes = vectors * np.sqrt(np.maximum(values, 0.0))
    signs = [np.array(s) for s in product((-1.0, 0.0, 1.0), repeat=3) if any(s)]
    directions = [s / np.linalg.norm(s) for s in signs]  # axes, edges and corners: 26 ways
    beside_lag = fit.cov - np.outer(fit.cov[1], fit.cov[1]) / fit.cov[1, 1]
    at_lag = [sign * math.sqrt(max(beside_lag[k, k], 0.0)) * np.eye(3)[k] for k in (0, 2) for sign in (-1, 1)]
    offsets = REGION * np.array([np.zeros(3), *(d @ axes.T for d in directions), *at_lag])
    centre = np.array([fit.lag, fit.dead_time])
    with np.errstate(divide="ignore", invalid="ignore"):
        room = np.where(offsets[:, 1:] < 0, centre / -offsets[:, 1:], np.inf)
    points = offsets * np.minimum(room.min(axis=1), 1.0)[:, None]
    gain = (fit.gain * np.exp(np.clip(points[:, 0], -20.0, 20.0)))[:, None]
    lag = np.maximum(fit.lag + points[:, 1], 0.0)[:, None]
    dead_time = np.maximum(fit.dead_time + points[:, 2], 0.0)[:, None]
    if fit.process == INTEGRATING:
        return IntegratingModel(gain, dead_time, lag)
    return SelfRegulatingModel(gain, dead_time, lag, np.full_like(lag, fit.lag2))


def op_noise(settings: Settings, noise: float, period: float) -> Array:
    """Return the standard deviation of OP [OP] that white noise of PV [PV] causes through P and filtered D (derived).

    With the backward difference, ``g = td/(tf + period)`` and ``a = tf/(tf + period)``, the controller's
    response to one sample of noise is ``1 + g``, then ``-g (1 - a) a^(j-1)``; its squares sum to
    ``(1 + g)^2 + g^2 (1 - a)/(1 + a)``. The integral's share is small and left out.
    """
    standard = settings.to("standard")
    td, tf = np.asarray(standard.td), np.asarray(standard.filter_time)
    g, a = td / (tf + period), tf / (tf + period)
    power = (1.0 + g) ** 2 + g**2 * (1.0 - a) / (1.0 + a)
    return np.asarray(np.abs(standard.kp) * np.sqrt(power) * noise).ravel()


def _stages(model: Model, today: Settings, new: Settings, allowed: float) -> list[Settings]:
    """Return steps of at most a factor of three in gain, each safe on the model by itself.

    Gain and times may move together, or the integral first, or the gain first: the way whose worst stage is
    safest is taken. One step where no way is safer than it.
    """
    n = max(math.ceil(abs(math.log(abs(float(new.kp) / float(today.kp)))) / math.log(STAGE)), 1)
    if n == 1:
        return [new]
    shares = [k / n for k in range(1, n + 1)]
    orders: list[Callable[[float], tuple[float, float]]] = [
        lambda x: (x, x),
        lambda x: (x, 1.0),  # times first
        lambda x: (x, 1.0 if x == 1.0 else 0.0),  # gain first
    ]
    ways = [[_between(today, new, *order(x)) for x in shares] for order in orders]
    every = _stack([settings for way in ways for settings in way])
    peaks = np.asarray(peak_sensitivity(model, every)).reshape(len(ways), n).max(axis=1)
    best = int(np.argmin(peaks))
    return ways[best] if peaks[best] <= allowed else [new]


def _between(today: Settings, new: Settings, gain_share: float, time_share: float) -> Settings:
    """Return the settings a share of the way, by ratio; a time that is 0 or inf at either end takes the new value."""

    def mix(name: str, share: float) -> float:
        a, b = float(getattr(today, name)), float(getattr(new, name))
        if share == 1.0 or not (0 < abs(a) < math.inf and 0 < abs(b) < math.inf) or a * b < 0:
            return b
        return _rounded(a * (b / a) ** share)

    td = mix("td", time_share)
    tf = mix("tf", time_share) if td > 0 else 0.0
    return replace(new, kp=mix("kp", gain_share), ti=mix("ti", time_share), td=td, tf=tf)
