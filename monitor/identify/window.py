"""An event's window laid out for the searches."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from monitor.contract.samples import Array
from monitor.detect.event import EventWindow
from tuners.models import INTEGRATING

from .projection import (
    MOST_POINTS,
    MOST_SHARE,
    P_DEAD_TIME,
    P_LAG,
    P_ONSET,
    P_SHARE,
    Columns,
    blocks,
    project,
)

NOISE_FREE_SHARE = 2e-3
"""Standard deviation of PV's second differences when quiet, as a share of PV's in the event, that is no noise."""
SINGLE, BESIDE, EVERY = ((P_DEAD_TIME, P_LAG), (P_LAG, P_SHARE), (P_DEAD_TIME, P_LAG, P_SHARE))
"""Parameters that are searched for: with one lag, at a given dead time, all; for a load the onset too."""


@dataclass(frozen=True, eq=False, slots=True)
class SearchWindow:
    """A window's columns, and what the searches of it need."""

    points: Columns
    """All points."""
    blocks: Columns
    """Means over blocks, in which a long window is searched; without noise some of its points."""
    pv: Array
    """(n,) as it was measured [PV]."""
    period: float | None
    """Sample period, if known [s]."""

    @property
    def kind(self) -> int:
        """As in `Columns`."""
        return self.points.kind

    @property
    def of_one_lag(self) -> list[int]:
        """Columns of `slopes`, but the second lag's."""
        return [0, 1, 3, 4, 5] if self.kind >= 2 else [0, 1, 3]

    @property
    def shows(self) -> bool:
        """Whether OP and PV moved."""
        return bool(np.any(self.points.held)) and bool(np.ptp(self.pv) != 0)

    def free(self, names: tuple[int, ...]) -> NDArray[np.int64]:
        """Return the places of these parameters, and of a load's onset."""
        return np.array(names + ((P_ONSET,) if self.kind >= 2 else ()))


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
    """
    kind = (0 if process == INTEGRATING else 1) + (2 if load else 0)
    t, u, y = (np.ascontiguousarray(x) for x in (window.time, op_from_rest(window, load), window.pv))
    points = Columns(t, t, u, project(y.copy(), t, kind), kind, bounds(t, kind))
    if two_lags and _noise_free(window):
        size = (len(t) + MOST_POINTS - 1) // MOST_POINTS
        at = t[::size].copy()
        few = points._replace(at=at, pv=project(y[::size].copy(), at, kind))
    else:
        at, mean, since, held = blocks(t, u, y, MOST_POINTS)
        few = Columns(at, since, held, project(mean, at, kind), kind, bounds(since, kind))
    return SearchWindow(points, few, y, period)


def _noise_free(window: EventWindow) -> bool:
    """Whether PV's noise before the event, by its second differences, is so small that no mean of it is needed.

    Means blur OP and PV; without noise that is all that a model leaves over.
    """
    quiet = window.pv[: max(window.before // 2, 3)]
    return float(np.std(np.diff(quiet, 2))) <= NOISE_FREE_SHARE * float(np.std(window.pv))


def op_from_rest(window: EventWindow, load: bool) -> Array:
    """OP as deviation from rest; (n,) [OP]. A load acted before it was noticed: the rest lies further back."""
    return window.op - np.mean(window.op[: max(window.before // 2 if load else window.before, 1)])


def bounds(t: Array, kind: int) -> Array:
    """Upper bounds of the parameters: an integrating process shows its lags in half a window, or never."""
    longest = t[-1] if kind % 2 else 0.5 * t[-1]
    return np.array([longest, 20.0 * longest, MOST_SHARE, 0.0])
