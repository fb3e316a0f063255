"""Noise that goes on: a load that wanders, beside which the process is looked for.

A load that wanders moves PV all the time, and OP answers it: to a fit that takes what is left for white noise, that
answer is the process, seen backwards. Here what is left is white noise and a walk of PV's level or trend, and the fit
is of the innovations (generalised least squares): the closed loop then biases nothing (Ljung 1999, ch. 13).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from monitor.contract.samples import Array

from .correlation import correlation_time
from .fit import Wander
from .other_loads import ALIKE_POINTS, LEAST_SETPOINT_REST_SHARE, OtherLoad, leaves_more
from .projection import P_DEAD_TIME, P_LAG, P_SHARE, Beside, Columns, evaluate, filter_of, innovations
from .response import response_at
from .search import search
from .window import SearchWindow

BELIEVED_LN = 3.0
"""Logarithm of the likelihood's ratio from which noise is believed to go on: 1 to 20. Wrongly believed it costs little
but wider intervals; not seen it moves the gain by 5 %, and the interval leaves the truth out."""
MOST_GROWTH = 2.0
"""Power of the innovations after the onset over that before it, up to which they may be the same noise."""
LOAD_BELIEVED_LN, ALIKE_LN = 30.0, 0.4
"""The same for a single load beside the step instead: a ramp explains up to 22 of what wanders, one that was there 88
and more. And the difference in ln gain up to which the two agree on the process: a load that explains the response
itself does not."""
RATIOS = {1: np.geomspace(1e-4, 10.0, 11), 2: np.geomspace(1e-6, 1.0, 7)}
"""By order: variance that the walk gains from sample to sample, in variances of the white noise (of a trend: in one
sample)."""
LEAST_BEFORE = 8
"""Points, or blocks, before the onset, without which it is not known what was there."""


class Wandering(NamedTuple):
    """A window with the noise that goes on in it."""

    window: SearchWindow
    best: Array
    single: Array
    """Best parameters, with the lags that were asked for and with one."""


def wanders(w: SearchWindow, p: Array) -> bool:
    """Whether noise that goes on is likelier than white noise, where the process is as these parameters say."""
    rest = np.empty(len(w.blocks.at))
    rss = evaluate(w.blocks, p, rest)[2]
    if not rss >= LEAST_SETPOINT_REST_SHARE * float(w.blocks.pv @ w.blocks.pv):
        return False
    return likelihood(_likeliest(w, p), p) - likelihood(w, p) >= BELIEVED_LN


def with_wander(w: SearchWindow, p: Array, two_lags: bool) -> Wandering | None:
    """Return the window with the likeliest noise that goes on, and its best model.

    None where nothing speaks for one, or where it was not there before the onset.

    Parameters
    ----------
    w
        The window, its noise white.
    p
        Its best parameters.
    two_lags
        A second lag is looked for.
    """
    walking = _likeliest(w, p)
    best, single = search(walking.blocks, two_lags)
    again = _likeliest(w, best)  # the noise by the model, the model by the noise, and once more
    if again.blocks.beside != walking.blocks.beside:
        walking = again
        best, single = search(walking.blocks, two_lags)
    believed = likelihood(walking, best) - likelihood(w, p) >= BELIEVED_LN
    return Wandering(walking, best, single) if believed and was_there_before(walking.blocks, best) else None


def goes_on(w: SearchWindow, p: Array) -> bool:
    """Whether the innovations that a model leaves are not white."""
    rest = np.empty(len(w.blocks.at))
    return not math.isfinite(evaluate(w.blocks, p, rest)[2]) or correlation_time(rest) > ALIKE_POINTS


def is_likelier(walking: Wandering, other: OtherLoad) -> bool:
    """Whether a load that wanders is believed rather than a single one beside the step.

    That one has to explain all, and to leave the process as it is.
    """
    gains = [evaluate(w.blocks, p, np.empty(len(w.blocks.at)))[0] for w, p in (walking[:2], other[:2])]
    agree = gains[0] * gains[1] > 0.0 and abs(math.log(gains[0] / gains[1])) <= ALIKE_LN
    better = likelihood(*other[:2]) - likelihood(*walking[:2]) >= LOAD_BELIEVED_LN
    return not (agree and better and not leaves_more(*other[:2]))


def _likeliest(w: SearchWindow, p: Array) -> SearchWindow:
    """Return the window with the noise that is likeliest where the process is as these parameters say."""
    step = float(w.points.at[-1] - w.points.at[0]) / len(w.points.at)
    tried = [
        (order, float(ratio) / step ** (1 if order == 1 else 3))
        for order, ratios in RATIOS.items()
        for ratio in ratios
    ]
    return w.wandering(*max(tried, key=lambda each: _of_blocks(w.wandering_blocks(*each), p)))


def was_there_before(w: Columns, p: Array) -> bool:
    """Whether what goes on in the noise did so before the onset, too: what a model lacks, and a load, come after it."""
    rest = np.empty(len(w.at))
    gain = evaluate(w, p, rest)[0]
    early, known = w.at < 0.0, np.arange(len(rest)) >= w.beside.order
    before, after = rest[known & early], rest[known & ~early]
    if len(before) < LEAST_BEFORE or len(after) == 0:
        return False
    lag2 = p[P_SHARE] * p[P_LAG]
    moved = gain * response_at(w.at, w.since, w.held, w.kind % 2, p[P_DEAD_TIME], p[P_LAG], lag2)
    at, left = w.at[early], (w.measured - moved)[early]
    walked = _of_innovations(left.copy(), at, w.beside)
    likelier = walked >= _of_innovations(left, at, w.beside._replace(ratio=0.0))
    return likelier and float(np.mean(after**2)) <= MOST_GROWTH * float(np.mean(before**2))


def _of_innovations(x: Array, at: Array, beside: Beside) -> float:
    """Return the logarithm of the likelihood of what is noise, in place."""
    by = filter_of(at, beside)
    innovations(x, by.walk)
    power = float(np.mean(x[beside.order :] ** 2))
    return -0.5 * len(x) * math.log(power) - 0.5 * by.volume if power > 0.0 else -math.inf


def likelihood(w: SearchWindow, p: Array) -> float:
    """Return the logarithm of the likelihood of a window's blocks, gain and load the best."""
    return _of_blocks(w.blocks, p)


def _of_blocks(w: Columns, p: Array) -> float:
    rest = np.empty(len(w.at))
    rss = evaluate(w, p, rest)[2]
    if not (math.isfinite(rss) and rss > 0.0):
        return -math.inf
    return -0.5 * len(rest) * math.log(rss / len(rest)) - 0.5 * w.filter.volume


def wander_of(w: SearchWindow) -> Wander | None:
    """Return what goes on in a window's noise; None where it is white."""
    beside = w.points.beside
    if beside.order == 0:
        return None
    return Wander(beside.order, beside.ratio)
