"""Single values of an event that nobody can have measured: a glitch of the line among good samples."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from monitor.detect.event import LOAD_STEP, ClosedEvent

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


def without_wild(event: ClosedEvent) -> ClosedEvent:
    """Return the event without wild values of PV: each is taken for the mean of its neighbours.

    What the integrated error owes to such values is taken away; the other integrals are not to be relied on any
    more, so that the event counts as one that did not begin at rest.
    """
    window = event.window
    wild = wild_values(window.pv, max(FAR * event.noise, STEPS * event.quantum))
    if event.kind == LOAD_STEP:  # how a load begins is not known
        wild = wild[np.abs(wild - window.before) > BEGINS]
    if len(wild) == 0:
        return event
    pv = window.pv.copy()
    pv[wild] = 0.5 * (window.pv[wild - 1] + window.pv[wild + 1])
    error = window.sp - pv
    counted = wild[wild >= window.before]
    too_much = float(np.sum((np.abs(window.sp - window.pv) - np.abs(error))[counted]) * event.period)
    amplitude = event.amplitude
    if event.kind == LOAD_STEP:
        rest = np.mean(error[: max(window.before, 1)])
        amplitude = min(amplitude, float(np.max(np.abs(error - rest))))
    clean = replace(window, pv=pv)
    return replace(event, window=clean, iae=event.iae - too_much, amplitude=amplitude, quiet=False)


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
