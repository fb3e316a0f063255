"""An event's window laid out for the searches."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from monitor.contract.samples import Array
from monitor.detect.event import EventWindow
from tuners.models import INTEGRATING

from .correlation import correlation_time
from .projection import (
    MOST_POINTS,
    MOST_SHARE,
    P_DEAD_TIME,
    P_LAG,
    P_ONSET,
    P_SHARE,
    P_WIDTH,
    Beside,
    Columns,
    blocks,
    columns_of,
    filter_of,
    project,
)
from .response import START, STEP

QUIET_SIGMAS = 3.0
"""Standard deviations by which the residuals' variance may exceed that of the noise before the event by chance."""
NOISE_FREE_SHARE = 1e-3
"""Standard deviation of PV's noise when quiet, as a share of PV's in the event, that is none: no mean of it is needed,
and means blur OP and PV."""
SINGLE, BESIDE, EVERY = ((P_DEAD_TIME, P_LAG), (P_LAG, P_SHARE), (P_DEAD_TIME, P_LAG, P_SHARE))
"""Parameters that are searched for: with one lag, at a given dead time, all; for a load the onset too."""


@dataclass(frozen=True, eq=False, slots=True)
class SearchWindow:
    """A window's columns, and what the searches of it need."""

    points: Columns
    """All points."""
    blocks: Columns
    """Means over blocks, in which a long window is searched; without noise some of its points."""
    noise: float
    """Standard deviation of PV's noise before the event [PV]."""
    quiet: float
    """Most that residuals may have as theirs by noise alone, coloured as it was before the event [PV]."""
    white: float
    """The same by white noise alone [PV]."""
    alike: float
    """How many points of it carry the information of one."""
    period: float | None
    """Sample period, if known [s]."""
    means: bool = True
    """The blocks are means."""

    @property
    def kind(self) -> int:
        """As in `Columns`."""
        return self.points.kind

    @property
    def each(self) -> float:
        """How many points a block is the mean of."""
        return max(round(len(self.points.at) / len(self.blocks.at)), 1) if self.means else 1

    @property
    def of_one_lag(self) -> list[int]:
        """Columns of `slopes`, but the second lag's."""
        if self.points.shape == START:
            return [0, 1, 3, 2, 4]
        if self.points.shape != STEP:
            return [0, 1, 3, 2, 4, 5, 6]  # a load's lag may be one of the process
        return [0, 1, 3, 4, 5] if self.kind >= 2 else [0, 1, 3]

    @property
    def load(self) -> bool:
        """Whether it is that of a load step."""
        return self.kind >= 2 and self.points.shape != START

    @property
    def shows(self) -> bool:
        """Whether OP and PV moved."""
        return bool(np.any(self.points.held)) and bool(np.ptp(self.points.measured) != 0)

    def with_load(self, shape: int) -> SearchWindow:
        """Return the window for a model in which a load comes in this shape, beside a set-point step at any time.

        With `START` for one of a loop that was not at rest.
        """
        if self.kind >= 2:
            return replace(
                self,
                points=self.points._replace(shape=shape),
                blocks=self.blocks._replace(shape=shape),
            )
        latest = float(self.points.at[-1])
        points, blocks = (laid_out(w, self.kind + 2, shape, latest) for w in (self.points, self.blocks))
        return replace(self, points=points, blocks=blocks)

    def wandering(self, order: int, ratio: float) -> SearchWindow:
        """Return the window for PV in whose noise a level or a trend wanders: as in `Beside`, ``ratio`` of a sample."""
        points, blocks = _wandering(self.points, order, ratio), self.wandering_blocks(order, ratio)
        return replace(self, points=points, blocks=blocks, quiet=self.white, alike=1.0)

    def wandering_blocks(self, order: int, ratio: float) -> Columns:
        """Return its blocks alone; ``ratio`` of a sample, too."""
        return _wandering(self.blocks, order, ratio * self.each)

    def free(self, names: tuple[int, ...]) -> NDArray[np.int64]:
        """Return the places of these parameters, and of a load's onset and width."""
        loads = {STEP: (P_ONSET,), START: ()}.get(self.points.shape, (P_ONSET, P_WIDTH))
        return np.array(names + (loads if self.kind >= 2 else ()))


def search_window(
    window: EventWindow, process: str, load: bool, period: float | None, two_lags: bool = False
) -> SearchWindow:
    """Lay out an event's window for the searches.

    Parameters
    ----------
    process
        Kind of process that is looked for.
    load
        A load stepped.
    period
        Sample period, if known [s].
    two_lags
        A second lag is looked for: where there is no noise, what blocks blur passes for it.

    A loop that was not at rest before a set-point move has a free start (`START`).
    """
    kind = (0 if process == INTEGRATING else 1) + (2 if load else 0)
    t, u, y = (np.ascontiguousarray(x) for x in (window.time, op_from_rest(window, load), window.pv))
    noise = _noise(window, load)
    picked = two_lags and noise <= NOISE_FREE_SHARE * float(np.std(y))
    if picked:
        size = (len(t) + MOST_POINTS - 1) // MOST_POINTS
        few = (t[::size].copy(), t, u, y[::size].copy())
    else:
        at, mean, since, held = blocks(t, u, y, MOST_POINTS)
        few = (at, since, held, mean)
    quiet = _quiet(window, load, noise)
    laid = SearchWindow(columns((t, t, u, y), kind), columns(few, kind), noise, *quiet, period, not picked)
    return laid if window.rested or load else laid.with_load(START)


def _wandering(w: Columns, order: int, ratio: float) -> Columns:
    """Return columns beside which a level or a trend wanders."""
    beside = w.beside._replace(order=order, ratio=ratio)
    by = filter_of(w.at, beside)
    return w._replace(beside=beside, filter=by, pv=project(w.measured.copy(), by))


def laid_out(w: Columns, kind: int, shape: int, last_onset: float) -> Columns:
    """Return columns for another model, of what was measured."""
    return columns((w.at, w.since, w.held, w.measured), kind, shape, last_onset)


def columns(
    raw: tuple[Array, Array, Array, Array], kind: int, shape: int = STEP, last_onset: float = 0.0
) -> Columns:
    """Make columns of times of PV, of OP, OP and PV as they were measured.

    Parameters
    ----------
    kind, shape
        As in `Columns`.
    last_onset
        When a load may come at the latest [s].
    """
    at, since, held, pv = raw
    # a load that is looked for beside a set-point step comes at any time, and OP need not have balanced another
    sloped = kind == 0 or (kind == 2 and last_onset > 0.0)
    high = bounds(since, kind, last_onset)
    return columns_of(at, since, held, pv, kind, high, shape, Beside(sloped))


def _noise(window: EventWindow, load: bool) -> float:
    """Return the standard deviation of PV's white noise before the event, by its second differences [PV]."""
    quiet = window.pv[: max(window.before // 2 if load else window.before, 3)]
    return float(np.std(np.diff(quiet, 2))) / math.sqrt(6.0)


def _quiet(window: EventWindow, load: bool, noise: float) -> tuple[float, float, float]:
    """Return what noise alone may give residuals, by PV before the event less its slope.

    The standard deviation as it is, and of the white noise in it [PV]; how many points carry the information of one.
    """
    m = max(window.before // 2 if load else window.before, 3)
    t, y = window.time[:m], window.pv[:m]
    rest = y - np.polynomial.polynomial.polyval(t, np.polynomial.polynomial.polyfit(t, y, 1))
    spread = float(rest @ rest) / max(m - 2, 1)
    # so few points tell a variance only roughly
    chance = QUIET_SIGMAS * math.sqrt(2.0 / m + 2.0 / len(window))
    most = math.sqrt(1.0 + chance)
    return math.sqrt(max(spread, noise**2)) * most, noise * most, correlation_time(rest)


def op_from_rest(window: EventWindow, load: bool) -> Array:
    """OP as deviation from rest; (n,) [OP]. A load acted before it was noticed: the rest lies further back."""
    return window.op - np.mean(window.op[: max(window.before // 2 if load else window.before, 1)])


def bounds(t: Array, kind: int, last_onset: float) -> Array:
    """Upper bounds of the parameters: an integrating process shows its lags in half a window, or never."""
    longest = t[-1] if kind % 2 else 0.5 * t[-1]
    return np.array([longest, 20.0 * longest, MOST_SHARE, last_onset, t[-1] - t[0]])
