"""An event's window laid out for the searches."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from monitor.detect.event import EventWindow

from .fit import Array
from .projection import DEAD, LAG, MOST_POINTS, ONSET, SHARE, blocks, project

SINGLE, BESIDE, EVERY = ((DEAD, LAG), (LAG, SHARE), (DEAD, LAG, SHARE))
"""Parameters that are searched for: with one lag, at a given dead time, all; for a load the onset too."""


def window_columns(window: EventWindow, load: bool) -> tuple[Array, Array, Array]:
    """Time, OP as deviation from rest, PV. A load acted before it was noticed: the rest lies further back."""
    rest = np.mean(window.op[: max(window.before // 2 if load else window.before, 1)])
    return window.time, window.op - rest, window.pv


# -- all models that explain a window ---------------------------------------------------------------


@dataclass(frozen=True, eq=False, slots=True)
class SearchWindow:
    """A window's columns, and what the searches of it need."""

    kind: int
    """As in `fitting`: 0, 1 for a set-point step, 2, 3 for a load step."""
    t: Array
    """(n,) [s]."""
    u: Array
    """(n,) OP from rest [OP]."""
    y: Array
    """(n,) PV, mean (and slope) taken out [PV]."""
    at: Array
    """(m,) times of PV in blocks [s]."""
    since: Array
    """(m,) times from which OP is held in blocks [s]."""
    held: Array
    """(m,) OP from rest, in blocks [OP]."""
    period: float | None
    """Sample period [s]."""
    mean: Array
    """(m,) PV in blocks, mean (and slope) taken out [PV]."""

    def free(self, names: tuple[int, ...]) -> NDArray[np.int64]:
        """Return the places of these parameters, and of a load's onset."""
        return np.array(names + ((ONSET,) if self.kind >= 2 else ()))


def search_window(t: Array, u: Array, y: Array, kind: int, period: float | None) -> SearchWindow:
    """Lay out a window for the searches.

    Parameters
    ----------
    t, u, y
        (n,) times [s], OP from rest [OP], PV [PV].
    kind
        As in `fitting`.
    period
        Sample period, if known [s].
    """
    at, mean, since, held = blocks(t, u, y, MOST_POINTS)
    return SearchWindow(
        kind, t, u, project(y.copy(), t, kind), at, since, held, period, project(mean, at, kind)
    )
