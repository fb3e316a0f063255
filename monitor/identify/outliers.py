"""Single values of an event that nobody can have measured: a glitch of the line among good samples."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from monitor.contract.samples import Array
from monitor.detect.event import LOAD_STEP, ClosedEvent

OUTLIER_SD, OUTLIER_QUANTA = 10.0, 3.0
"""Standard deviations of PV's noise, and steps of a coarse PV, by which such a value must stand out of both its
neighbours."""
ALONE_RATIO = 5.0
"""How many times further away it must be than its neighbours are from each other, and than others are from theirs."""
ONSET_SAMPLES = 2
"""Samples to either side of a load's onset where PV may do what it likes."""
AROUND_SAMPLES = 8
"""Neighbours to either side that are looked at."""


def without_outliers(event: ClosedEvent) -> ClosedEvent:
    """Return the event without outliers of PV: each is taken for the mean of its neighbours.

    What the integrated error owes to such values is taken away; the other integrals are not to be relied on any
    more, so that the event counts as one that did not begin at rest.
    """
    window = event.window
    at = outliers(window.pv, max(OUTLIER_SD * event.noise, OUTLIER_QUANTA * event.quantum))
    if event.kind == LOAD_STEP:  # how a load begins is not known
        at = at[np.abs(at - window.before) > ONSET_SAMPLES]
    if len(at) == 0:
        return event
    pv = window.pv.copy()
    pv[at] = 0.5 * (window.pv[at - 1] + window.pv[at + 1])
    error = window.sp - pv
    counted = at[at >= window.before]
    too_much = float(np.sum((np.abs(window.sp - window.pv) - np.abs(error))[counted]) * event.period)
    amplitude = event.amplitude
    if event.kind == LOAD_STEP:
        rest = np.mean(error[: max(window.before, 1)])
        amplitude = min(amplitude, float(np.max(np.abs(error - rest))))
    clean = replace(window, pv=pv)
    return replace(event, window=clean, iae=event.iae - too_much, amplitude=amplitude, quiet=False)


def outliers(pv: Array, far: float) -> NDArray[np.intp]:
    """Return where single values stand out of both neighbours, as nothing else around does, and by ``far`` [PV]."""
    if len(pv) < AROUND_SAMPLES:
        return np.zeros(0, np.intp)
    left, right = pv[1:-1] - pv[:-2], pv[1:-1] - pv[2:]
    out = np.where(left * right > 0.0, np.minimum(np.abs(left), np.abs(right)), 0.0)
    found = np.flatnonzero((out > far) & (out > ALONE_RATIO * np.abs(left - right)) & (out > 0.0))
    bend = np.abs(left + right)
    return np.array([i + 1 for i in found if out[i] > ALONE_RATIO * _usual(bend, int(i))], np.intp)


def _usual(bend: Array, i: int) -> float:
    """Return how far the values around the i-th usually are from the mean of their neighbours, twice."""
    around = np.r_[bend[max(i - AROUND_SAMPLES, 0) : max(i - 1, 0)], bend[i + 2 : i + 2 + AROUND_SAMPLES]]
    return float(np.max(around)) if len(around) else 0.0
