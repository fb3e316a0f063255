"""Whether a loop's set point and process variable are in different units. Samples in, a line out."""

from __future__ import annotations

import numpy as np

from .loops import Loop
from .samples import Array

LEAST_SAMPLES = 20
"""Samples without which nothing is said."""
MOST_SHARE = 0.5
"""Share of them that must be so."""
LEAST_RATIO = 5.0
"""SP over PV, or PV over SP, from which on they look like different units: 1 bar is 14.5 psi, 1 % of 3 m 30 mm."""
RATIO_SHARE = 0.25
"""Half the spread of that ratio at most, relative: a PV that is far from its SP wanders, a unit does not."""

LASTING_SHARE = 0.5
"""Of the error of some samples, from which on the mean error of the record is the same."""


def unit_mismatch(loop: Loop, sp: Array, pv: Array) -> str:
    """Say in one line that SP and PV look like different units; empty where they do not.

    Parameters
    ----------
    sp, pv
        (N,) samples in automatic [PV].
    """
    good = np.isfinite(sp) & np.isfinite(pv)
    sp, pv = sp[good], pv[good]
    if len(sp) < LEAST_SAMPLES:
        return ""
    shown = f"SP is {sp[0]:.6g} where PV is {pv[0]:.6g}"
    low, high = loop.pv_low, loop.pv_high
    if low is not None and high is not None:
        margin = high - low
        outside = (sp < low - margin) | (sp > high + margin)
        inside = (pv >= low - 0.1 * margin) & (pv <= high + 0.1 * margin)
        if np.mean(outside & inside) > MOST_SHARE:
            return f"{shown}, far outside of pv_low ... pv_high = {low:g} ... {high:g}: other units than PV's; {_HELP}"
        return ""
    ratios = sp[(sp != 0) & (pv != 0)] / pv[(sp != 0) & (pv != 0)]
    if len(ratios) < MOST_SHARE * len(sp):
        return ""
    middle = float(np.median(ratios))
    far = middle >= LEAST_RATIO or 0 < middle <= 1 / LEAST_RATIO
    if far and np.mean(np.abs(ratios - middle) <= RATIO_SHARE * abs(middle)) > MOST_SHARE:
        return f"{shown}: other units, by a constant ratio of about {middle:.1g}? {_HELP}"
    return ""


def lasts(offset: float | None, sp: Array, pv: Array) -> bool:
    """Whether the error of some samples is there in the whole record, too: a unit stays, a pump starts.

    Parameters
    ----------
    offset
        Mean error of the whole record [PV]; None where it is not known.
    sp, pv
        (N,) samples in automatic [PV].
    """
    return offset is not None and abs(offset) >= LASTING_SHARE * abs(float(np.nanmedian(sp - pv)))


_HELP = "export both in the same unit"
