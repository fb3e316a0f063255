"""Whether what looks like a load is the tail of something that began before the data, a gap or automatic did."""

from __future__ import annotations

import math

import numpy as np

from monitor.detect.event import EventWindow
from tuners.models import INTEGRATING, SELF_REGULATING

from .direct import LEAST_POINTS
from .fit import Fit
from .projection import evaluate
from .response import START
from .search import search
from .window import search_window

BELIEVED_LN = 8.0
"""Logarithm of the likelihood's ratio from which a load is believed instead: its time and size are sought."""
EXPLAINED_SHARE = 0.95
"""Share of PV's variance that a model without any load must leave to one: after 40 loads on loops that had come to rest
it explained at most .56, of 30 tails .93 at least; what more lags leave of it looks like a load that came at once."""
LEAST_EXPLAINED_SHARE = 0.8
"""The same for a tail in noise: what explains less is none, however little a step of the load explains."""
REST_POINTS, REST_PARTS, REST_SHARE = 12, 4, 0.05
"""Points, parts of them, and share of all movement by which the parts' means may differ, for a loop to be at rest."""


def _rested(window: EventWindow) -> bool:
    """Whether PV and OP stood still, but for noise, in the first half of what is before: a tail does not."""
    m = window.before // 2
    if m < REST_POINTS:
        return False
    for column in (window.pv, window.op):
        means = [part.mean() for part in np.array_split(column[:m], REST_PARTS)]
        if np.ptp(means) > REST_SHARE * np.ptp(column):
            return False
    return True


def is_tail(window: EventWindow, fit: Fit | None, period: float) -> bool:
    """Whether PV's movement follows from OP and from how PV moved when the window began, without any load.

    Either kind of process may explain it so: nearly all of it, or, compared by likelihood over independent points, as
    well as ``fit``, a model with a load.
    """
    if len(window) < LEAST_POINTS or np.ptp(window.pv) == 0.0 or np.ptp(window.op) == 0.0:
        return False
    if _rested(window):
        return False
    load = 0.0 if fit is None else fit.sigma**2 * max(len(window) - 6, 1)
    for process in (INTEGRATING, SELF_REGULATING):
        w = search_window(window, process, False, period).with_load(START)
        best, _ = search(w.blocks, False)
        rest = np.empty(len(w.points.at))
        rss = evaluate(w.points, best, rest)[2]
        if not math.isfinite(rss):
            continue
        left = rss / float(np.sum((window.pv - window.pv.mean()) ** 2))
        if left < 1.0 - EXPLAINED_SHARE:
            return True
        if (
            left < 1.0 - LEAST_EXPLAINED_SHARE
            and fit is not None
            and 0.5 * fit.n_eff * math.log(rss / load) < BELIEVED_LN
        ):
            return True
    return False
