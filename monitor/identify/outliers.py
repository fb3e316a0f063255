"""Single values of an event that nobody can have measured: a glitch of the line among good samples."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from monitor.detect.state import LOAD_STEP

from .fit import Array

FAR, STEPS = 10.0, 3.0
"""Standard deviations of PV's noise, and steps of a coarse PV, by which such a value must stand out of both its
neighbours."""
ALONE = 5.0
"""How many times further away it must be than its neighbours are from each other, and than others are from theirs."""
BEGINS = 2
"""Samples to either side of a load's onset where PV may do what it likes."""
AROUND = 8
"""Neighbours to either side that are looked at."""


def without_wild(event: Any, window: Array) -> tuple[Any, Array]:
    """Return event and window without wild values of PV: each is taken for the mean of its neighbours.

    Parameters
    ----------
    event
        Row of dtype `detect.OUT`; a copy is returned, with what its integrals owe to such values taken away.
    window
        (n, 4) time [s], SP, PV [PV], OP [OP].
    """
    wild = wild_values(window[:, 2], max(FAR * float(event["noise"]), STEPS * float(event["quantum"])))
    if event["kind"] == LOAD_STEP:  # how a load begins is not known
        wild = wild[np.abs(wild - int(event["before"])) > BEGINS]
    if len(wild) == 0:
        return event, window
    clean, mended = window.copy(), event.copy()
    clean[wild, 2] = 0.5 * (window[wild - 1, 2] + window[wild + 1, 2])
    before, after = (np.abs(w[:, 1] - w[:, 2]) for w in (window, clean))
    counted = wild[wild >= event["before"]]
    mended["iae"] -= float(np.sum((before - after)[counted]) * event["period"])
    mended["quiet"] = 0.0  # the other integrals are not to be relied on
    if event["kind"] == LOAD_STEP:
        error = clean[:, 1] - clean[:, 2]
        rest = np.mean(error[: max(int(event["before"]), 1)])
        mended["amplitude"] = min(float(event["amplitude"]), float(np.max(np.abs(error - rest))))
    return mended, clean


def wild_values(pv: Array, far: float) -> NDArray[np.intp]:
    """Return where single values stand out of both neighbours, as nothing else around does, and by ``far`` [PV]."""
    if len(pv) < AROUND:
        return np.zeros(0, np.intp)
    left, right = pv[1:-1] - pv[:-2], pv[1:-1] - pv[2:]
    out = np.where(left * right > 0.0, np.minimum(np.abs(left), np.abs(right)), 0.0)
    found = np.flatnonzero((out > far) & (out > ALONE * np.abs(left - right)) & (out > 0.0))
    bend = np.abs(left + right)
    return np.array([i + 1 for i in found if out[i] > ALONE * _usual(bend, int(i))], np.intp)


def _usual(bend: Array, i: int) -> float:
    """Return how far the values around the i-th usually are from the mean of their neighbours, twice."""
    around = np.r_[bend[max(i - AROUND, 0) : max(i - 1, 0)], bend[i + 2 : i + 2 + AROUND]]
    return float(np.max(around)) if len(around) else 0.0
