"""An event's window to a process model with intervals.

Two independent ways: running integrals (exact without noise, any linear controller) and a separable
least-squares fit (variable projection, Golub & Pereyra 1973) of a model to the window. A suggestion rests on
the fit; the integrals check it.

An integrating process is fitted with one effective lag, and its tangents tell how far other models reach. A
self-regulating one needs its second lag: dead time, lags, gain and a load's onset share what the data say, the
likelihood is a long bent valley, and no tangent describes it. The valley is walked instead (derived).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from monitor.contract.samples import Array
from monitor.detect.event import EventWindow
from tuners.models import INTEGRATING, SELF_REGULATING

from .correlation import correlation_time
from .fit import ALIKE_DEAD_TIMES, DECIDES_LN, SIMPLER_LN, Fit, Load, Valley, better_by
from .other_loads import leaves_more, with_other_load
from .projection import P_DEAD_TIME, P_LAG, P_ONSET, P_SHARE, P_WIDTH, evaluate, slopes
from .response import LAG, START, STEP, load_of_shape, response, start_response
from .search import descend, search, walk
from .uncertainty import (
    OTHER_LOAD_FLOOR_RATIOS,
    OTHER_LOAD_LN_GAIN_SD,
    SECOND_LAG_SHARE,
    across_valley,
    beyond_noise,
    covariance_by_tangents,
    covariance_of_lost_samples,
    half_rule,
    node_weights,
    of_loads_lag,
    of_second_lag,
    shrunk_variance,
    tangent_scatter,
    with_uncertainty,
)
from .wander import goes_on, is_likelier, wander_of, wanders, with_wander
from .window import BESIDE, EVERY, SINGLE, SearchWindow, op_from_rest, search_window

LEAST_POINTS = 12
"""Points without which a window tells nothing."""
LEAST_NOISE_SHARE = 1e-10
"""Least power of the residuals, as a share of PV's: no model is better than that, and no number either."""


def fit_kinds(
    window: EventWindow, kinds: list[str], load: bool = False, period: float | None = None
) -> list[Fit]:
    """Fit the kinds of process that a loop may be, as `fit_window` does one; what cannot be fitted is left out.

    Where both are asked for, their likelihoods can be compared: both are of models with two lags. Where no kind
    explains the window with a step of the load, or without one, a load of another shape is looked for in all of them:
    it would explain the wrong kind of process as well. After a set-point step, where a load beside it would be chance,
    the other kind must not explain it either; loads are seldom steps.
    """
    compared = len(kinds) > 1
    looks = [look for kind in kinds if (look := _look(window, kind, load, period, compared=compared))]
    beside = _leave_more(looks)
    if beside and not compared and not load:
        other = SELF_REGULATING if kinds[0] == INTEGRATING else INTEGRATING
        look = _look(window, other, load, period, compared=False)
        beside = look is None or not look.explains or look.more
    fits: list[Fit] = []
    for look in looks if any(look.explains for look in looks) else ():
        fit = _fitted(window, look, fits[0] if fits else None, other_loads=beside)
        fits += [] if fit is None else [fit]
    return fits


def fit_window(
    window: EventWindow, process: str, load: bool = False, period: float | None = None,
    compared: bool = False, rival: Fit | None = None, other_loads: bool = False,
) -> Fit | None:  # fmt: skip
    """Fit the half-rule model of one kind of process to a window.

    Parameters
    ----------
    window
        The output's rest value is taken from its points before the onset.
    process
        ``integrating``: ``y = mu F(lag, dead time)[int u] + c0 + c1 t`` (c1: a load that OP did not balance);
        ``self-regulating``: ``y = K F(lag, lag2, dead time)[u] + c0``.
    load
        A load stepped, before time zero: its size and onset are fitted too (without c1).
    period
        Sample period, which a thinned window no longer shows; by default the median step of its times [s].
    compared
        The likelihood is to be compared with that of the other kind.
    rival
        An integrating model of the window: where it is not beaten, a self-regulating one's uncertainty is only
        told roughly.
    other_loads
        A load of another shape may be found; and one that wanders, but not after a load, for the two are one then.

    Returns
    -------
    Fit or None
        None where OP or PV did not move, or the window is too short to tell (fewer than 12 points).
    """
    look = _look(window, process, load, period, compared=compared)
    return None if look is None else _fitted(window, look, rival, other_loads=other_loads)


def _look(
    window: EventWindow, process: str, load: bool, period: float | None, *, compared: bool
) -> _Look | None:
    """Look for the best model beside white noise; None where the window shows nothing. As in `fit_window`."""
    if len(window) < LEAST_POINTS:
        return None
    two_lags = compared or process != INTEGRATING
    w = search_window(window, process, load, period, two_lags)
    if not w.shows:
        return None
    best, single = search(w.blocks, two_lags)
    mine = best if two_lags else single
    left = leaves_more(w, mine)
    gain, _, rss = evaluate(w.blocks, best, np.empty(len(w.blocks.at)))
    explains = math.isfinite(rss) and math.isfinite(gain) and gain != 0.0
    return _Look(
        process, w, two_lags, best, single, left, left or (not w.load and wanders(w, mine)), explains
    )


def _leave_more(looks: list[_Look]) -> bool:
    """Whether all models that explain something leave more than white noise."""
    explain = [look.more for look in looks if look.explains]
    return bool(explain) and all(explain)


def _fitted(window: EventWindow, look: _Look, rival: Fit | None, *, other_loads: bool) -> Fit | None:
    """Go on from the best model beside white noise to a fit; None where OP explains nothing. As in `fit_window`."""
    found = _explain(look, rival, other_loads=other_loads)
    if found is None:
        return None
    process, w, best, p = look.process, found.window, found.best, found.best.p
    model = (best.gain, float(p[P_LAG]), float(p[P_DEAD_TIME]), float(p[P_LAG] * p[P_SHARE]))
    wander = wander_of(w)
    fit = with_uncertainty(process, model, window.time, window.pv, found.residual, best.scatter, w.period)
    started, load = look.window.points.shape == START, look.window.load
    other, floor = (None if wander is not None else found.other), fit.floor
    if wander is not None or other is not None:
        floor = floor * OTHER_LOAD_FLOOR_RATIOS
        floor[0] += OTHER_LOAD_LN_GAIN_SD**2 if other is not None and process == SELF_REGULATING else 0.0
    return replace(
        fit,
        log_likelihood=found.log_likelihood,
        n_eff=found.n_eff,
        valley=best.valley,
        wander=wander,
        leaves_more=found.leaves_more,
        start=best.load if started and found.other is None else 0.0,
        other=other,
        floor=floor,
        size=best.load / best.gain if load and wander is None else None,
        onset=float(p[P_ONSET]) if load and wander is None else None,
    )


def model_response(window: EventWindow, fit: Fit) -> Array:
    """PV as the model gives it from the window's OP, offset (and slope, if integrating) fitted; (n,) [PV]."""
    t, kind = window.time, 0 if fit.process == INTEGRATING else 1
    x = np.sum(parts_of_pv(window, fit), axis=0)
    rest, age = window.pv - x, t - np.mean(t)
    slope = float(age @ rest / (age @ age)) if kind == 0 else 0.0
    return np.asarray(x + np.mean(rest) + slope * age, dtype=np.float64)


def parts_of_pv(window: EventWindow, fit: Fit) -> list[Array]:
    """Return what OP and, where there is one, the load do to PV by a model; each (n,) [PV]."""
    t = np.ascontiguousarray(window.time)
    times = fit.dead_time, fit.lag, fit.lag2
    kind = 0 if fit.process == INTEGRATING else 1
    parts = [fit.gain * response(t, op_from_rest(window, fit.size is not None), kind, *times)]
    if fit.start != 0.0:
        parts.append(fit.start * start_response(t - t[0], fit.lag))
    load = fit.other
    if load is None and fit.size is not None and fit.onset is not None:
        load = Load(fit.size, fit.onset, 0.0, STEP)
    if load is not None:
        parts.append(
            load.size * load_of_shape(t - load.onset, kind, fit.gain, *times, load.width, load.shape)
        )
    return parts


class _Optimum(NamedTuple):
    """A model in the parameters of `search`, and how far others reach that explain the window as well."""

    p: Array
    gain: float
    load: float
    """Gain times the load's size [PV/s] or [PV]; 0 without a load."""
    scatter: Array
    """(3, 3) covariance of (ln |gain|, lag, dead time); half a second lag counts for each."""
    valley: Valley | None


@dataclass(frozen=True, eq=False, slots=True)
class _Look:
    """The best model of a window beside white noise, before how far others reach is asked."""

    process: str
    window: SearchWindow
    two_lags: bool
    best: Array
    single: Array
    """Best parameters, with the lags that were asked for and with one."""
    left: bool
    """It leaves more of PV than the noise before the event (`leaves_more`)."""
    more: bool
    """So it does, or what it leaves goes on."""
    explains: bool
    """OP explains something."""


@dataclass(frozen=True, eq=False, slots=True)
class _Found:
    """The model of a window."""

    best: _Optimum
    window: SearchWindow
    """As it was searched in the end."""
    residual: Array
    """(n,) of its points [PV]."""
    log_likelihood: float
    """-n_eff/2 ln(residual variance) of the best model with two lags."""
    n_eff: float
    """Independent points, of which that likelihood is."""
    other: Load | None
    leaves_more: bool


def _explain(look: _Look, rival: Fit | None, *, other_loads: bool) -> _Found | None:
    """Find the model of a window and its reach; None where OP explains nothing of PV."""
    w, two_lags, best, single, more = look.window, look.two_lags, look.best, look.single, look.more
    mine = best if two_lags else single
    other = with_other_load(w, mine, EVERY if two_lags else SINGLE) if look.left and other_loads else None
    walking = with_wander(w, mine, two_lags) if more and other_loads and not w.load else None
    if walking is not None and (other is None or is_likelier(walking, other)):
        w, best, single = walking
        other, more = None, goes_on(w, best if two_lags else single)
    elif other is not None:
        w, best = other.window, other.p
        single = best
    rest = np.empty(len(w.blocks.at))
    gain, _, rss = evaluate(w.blocks, best, rest)
    if not math.isfinite(rss) or not math.isfinite(gain) or gain == 0.0:
        return None
    rss = max(rss, LEAST_NOISE_SHARE * float(w.blocks.pv @ w.blocks.pv))
    n_eff = len(rest) / correlation_time(rest)
    of_best = -0.5 * n_eff * (math.log(rss / len(rest)) + w.blocks.filter.volume / len(rest))
    if w.kind % 2 == 0:
        found = _one_lag(w, single)
    elif rival is not None and _not_believed(
        w, best, better_by(of_best, n_eff, rival.log_likelihood, rival.n_eff)
    ):
        found = _one_lag(w, best)
    else:
        n, m = len(w.points.at), len(rest)
        beyond = beyond_noise(rest, w.quiet * (math.sqrt(m / n) if w.means else 1.0), w.alike)
        found = _two_lags(w, best, rss / n_eff, beyond * m)
    residual = np.empty(len(w.points.at))
    evaluate(w.points, found.p, residual)
    if found.gain == 0.0 or not (math.isfinite(found.gain) and np.isfinite(residual).all()):
        return None
    lost = covariance_of_lost_samples(w, found.p, found.gain, found.load)
    valley = None if found.valley is None else replace(found.valley, across=found.valley.across + lost)
    found = found._replace(scatter=found.scatter + lost, valley=valley)
    if other is not None:
        valley = None if valley is None else replace(valley, across=valley.across + other.spread)
        found = found._replace(scatter=found.scatter + other.spread, valley=valley)
    p, shape, load = found.p, w.points.shape, found.load / found.gain
    shaped = None if shape in {STEP, START} else Load(load, float(p[P_ONSET]), float(p[P_WIDTH]), shape)
    if not np.isfinite(found.scatter).all():
        return None
    return _Found(found, w, residual, of_best, n_eff, shaped, more)


def _not_believed(w: SearchWindow, p: Array, better: float) -> bool:
    """Whether `decide` will prefer the integrating model."""
    alike = p[P_LAG] > min(
        2.0 * float(w.points.at[-1]), ALIKE_DEAD_TIMES * float(p[P_DEAD_TIME] + p[P_LAG] * p[P_SHARE] / 2)
    )
    return better <= -SIMPLER_LN or (better < DECIDES_LN and alike)


def _one_lag(w: SearchWindow, start: Array) -> _Optimum:
    """Return the best model with this second lag, by its tangents."""
    starts = [start]
    if start[P_LAG] < 0.1 * start[P_DEAD_TIME]:  # a lag of a block's length or less is not seen in blocks
        starts.append(
            np.array([0.75, 0.25, 0.0, 0.0, 0.0]) * (start[P_LAG] + start[P_DEAD_TIME])
            + np.array([0, 0, *start[2:]])
        )
    tried = [descend(w.points, s, w.free(SINGLE), 0.0, 20, 1e-7) for s in starts]
    p, gain, load, _, _ = min(tried, key=lambda found: found[3])
    residual = np.empty(len(w.points.at))
    evaluate(w.points, p, residual)
    tangents = slopes(w.points, p, gain, load)
    t = w.points.at
    step = float(t[-1] - t[0]) / len(t)
    t0 = float(p[P_DEAD_TIME] + p[P_LAG])
    columns = tangents[:, w.of_one_lag]
    if w.points.shape != STEP:
        columns[:, 3] = of_second_lag(w, p, gain, load)
    elif w.kind >= 2:
        columns = np.insert(columns, 3, of_loads_lag(w.points, w.with_load(LAG).points, p, load), axis=1)
    scatter = tangent_scatter(residual, columns, t0, step, w.quiet, w.kind >= 2, w.alike)
    return _Optimum(p, gain, load, scatter, None)


def _two_lags(w: SearchWindow, start: Array, noise: float, beyond: float) -> _Optimum:
    """Return the model in the middle of the valley.

    ``start`` is the best model of the blocks, ``noise`` the power of an independent one of their residuals,
    ``beyond`` that of what is no noise in them [PV^2].
    """
    best = start
    t = w.points.at
    if len(t) > len(w.blocks.at):
        best = descend(w.points, start, w.free(EVERY), 0.0, 8, 1e-7)[0]
    cov = covariance_by_tangents(w, start, noise + beyond)
    # a prior of one sigma costs as much as one sigma of noise
    prior = noise / SECOND_LAG_SHARE**2
    stride = max(0.5 * math.sqrt(cov[3, 3]), 1e-6 * float(t[-1] - t[0]))
    nodes = walk(w.blocks, start, stride, prior, 0.5 / noise)
    nodes = nodes[np.argsort(nodes[:, P_DEAD_TIME])]
    weight = node_weights(nodes[:, P_DEAD_TIME], nodes[:, -1])
    middle = max(float(weight @ nodes[:, P_DEAD_TIME] + best[P_DEAD_TIME] - start[P_DEAD_TIME]), 0.0)
    near = nodes[np.argmin(np.abs(nodes[:, P_DEAD_TIME] - middle)), :5].copy()
    near[P_DEAD_TIME] = middle
    p, gain, load, _, _ = descend(w.points, near, w.free(BESIDE), prior * len(t) / len(w.blocks.at), 10, 1e-5)
    away = half_rule(nodes, nodes[:, 5]) - half_rule(p[None], np.array([gain]))
    across = across_valley(cov)
    models = np.column_stack(
        [nodes[:, 5], nodes[:, P_LAG], nodes[:, P_DEAD_TIME], nodes[:, P_LAG] * nodes[:, P_SHARE]]
    )
    valley = Valley(models, 2.0 * (nodes[:, -1].max() - nodes[:, -1]), across)
    along = shrunk_variance(nodes[:, P_DEAD_TIME], middle, weight) * (away.T * weight) @ away
    return _Optimum(p, gain, load, across + along, valley)
