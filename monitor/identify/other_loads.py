"""Loads that are no step at the event's begin: through a lag, a ramp, or one that comes during a set-point step.

They are looked for where a step, or no load, leaves more than noise, and kept where the likelihood says so. What is
told of the process then counts the load's shape among what is not known.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from monitor.contract.samples import Array

from .correlation import correlation_time
from .projection import P_DEAD_TIME, P_LAG, P_ONSET, P_SHARE, P_WIDTH, Columns, columns_of, evaluate
from .response import LAG, RAMP
from .search import best_of_grid, descend
from .uncertainty import half_rule
from .window import SearchWindow

NOISE_RATIO = 1.5
"""Power of what is left over that of the noise before the event, from which it is more than that."""
ALIKE_POINTS = 2.5
"""Points that carry the information of one, likewise: noise is white, what a model lacks is not."""
LEAST_LOAD_REST_SHARE, LEAST_SETPOINT_REST_SHARE = 3e-4, 3e-3
"""Share of PV's power that is left at least. Loads are seldom steps; one beside a set-point step is chance, and must
have moved PV by a twentieth of what the step did."""
BELIEVED_LN = 8.0
"""Logarithm of the likelihood's ratio from which such a load is believed: many are tried."""
GRID_POINTS = 60
"""Points of a window on which the grid is tried."""
START_COUNT = 3
"""The best of them, each with another time of the load, from which the search goes on."""
LAG_COUNT, ONSET_COUNT, WIDTH_COUNT = 4, 12, 3
"""Lines of the grid, for dead times and lags alike, for times of the load, and for its widths."""


class OtherLoad(NamedTuple):
    """A window with a load of another shape."""

    window: SearchWindow
    p: Array
    """The best parameters."""
    spread: Array
    """(3, 3) covariance of (ln |gain|, lag, dead time) because it might have been the other shape."""


def with_other_load(w: SearchWindow, p: Array, names: tuple[int, ...]) -> OtherLoad | None:
    """Return the window with a load of the likelier shape; None where nothing speaks for one.

    Parameters
    ----------
    w
        The window, laid out for a step at its begin.
    p
        Its best parameters.
    names
        Those of them that are searched for.
    """
    rest = np.empty(len(w.blocks.at))
    rss = evaluate(w.blocks, p, rest)[2]
    tried = []
    for shape in (RAMP, LAG) if w.kind >= 2 else (RAMP,):
        other = w.with_load(shape)
        found = [
            descend(other.blocks, start, other.free(names), 0.0, 20, 1e-4) for start in _starts(other, p)
        ]
        q, gain, _, left, _ = min(found, key=lambda each: each[3])
        tried.append((left, other, q, gain))
    tried.sort(key=lambda each: each[0])
    _, other, q, _ = tried[0]
    q, gain, _, left, _ = descend(other.blocks, q, other.free(names), 0.0, 30, 1e-6)
    evaluate(other.blocks, q, rest)
    independent = len(rest) / correlation_time(rest)
    if not left > 0.0 or 0.5 * independent * math.log(rss / left) < BELIEVED_LN:
        return None
    spread = np.zeros((3, 3))
    for less, _, p2, gain2 in tried[1:]:
        apart = half_rule(p2[None], np.array([gain2])) - half_rule(q[None], np.array([gain]))
        spread += apart.T @ apart / (1.0 + math.exp(min(0.5 * independent * math.log(less / left), 50.0)))
    return OtherLoad(other, q, spread)


def leaves_more(w: SearchWindow, p: Array) -> bool:
    """Whether a model leaves more of PV than the noise that was there before the event."""
    rest = np.empty(len(w.blocks.at))
    rss, n = evaluate(w.blocks, p, rest)[2], len(rest)
    least = LEAST_LOAD_REST_SHARE if w.kind >= 2 else LEAST_SETPOINT_REST_SHARE
    if not math.isfinite(rss) or rss < least * float(w.blocks.pv @ w.blocks.pv):
        return False
    each = max(round(len(w.points.at) / n), 1)
    return rss / n > NOISE_RATIO * w.noise**2 / each or correlation_time(rest) > ALIKE_POINTS


def _starts(w: SearchWindow, p: Array) -> list[Array]:
    """Return where to look from: the best of a grid, and the step's own model with a narrow and a wide load."""
    t = w.blocks.at
    span = float(t[-1] - t[0])
    step, t0 = span / len(t), float(p[P_DEAD_TIME] + p[P_LAG] * (1.0 + p[P_SHARE])) + span / len(t)
    longest = 0.5 * float(w.blocks.high[P_DEAD_TIME])
    lags = np.r_[0.0, np.geomspace(step, max(longest, 2.0 * step), LAG_COUNT)]
    if w.points.high[P_ONSET] > 0.0:  # at any time of the window
        onsets = np.linspace(t[0], 0.9 * t[-1], ONSET_COUNT)
        widths = np.array([0.0, 0.2 * span, span])
    else:
        onsets = -np.geomspace(step, max(-t[0], 2.0 * step), ONSET_COUNT // 3)
        widths = np.geomspace(step, 0.3 * span, WIDTH_COUNT)
    nodes = best_of_grid(_thinned(w.blocks), lags, lags, onsets, widths)
    found = [node[:5].copy() for node in nodes[np.argsort(nodes[:, 5])[:START_COUNT]]]
    for width in (t0, 5.0 * t0):
        q = p.copy()
        q[P_WIDTH] = min(width, 0.5 * span)
        q[P_ONSET] = max(p[P_ONSET] - 0.5 * q[P_WIDTH], t[0])
        found.append(q)
    return found


def _thinned(w: Columns) -> Columns:
    """Return the columns at fewer times of PV."""
    thin = max(len(w.at) // GRID_POINTS, 1)
    at = w.at[::thin].copy()
    measured = w.measured[::thin].copy()
    return columns_of(at, w.since, w.held, measured, w.kind, w.high, w.shape, w.beside)
