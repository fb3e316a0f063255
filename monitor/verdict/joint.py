"""What several events say of the process together."""

from __future__ import annotations

import math
from collections import Counter

from monitor.assess.event import Finding
from monitor.assess.evidence import is_wide
from monitor.identify.fit import Fit, combine, contradictory

from .gains import goes_with


def narrow_together(wide: list[Finding]) -> bool:
    """Whether events, of which none knows the gain well enough, know it together."""
    joint, why = joint_of(wide) if wide else (None, "")
    return joint is not None and not why and not is_wide(joint)


def joint_of(usable: list[Finding]) -> tuple[Fit | None, str]:
    """Put events into one model; beside it why that is no use, empty where it is. None: they have nothing in common.

    Of two kinds of process the one that more events show is taken, the newer one of as many: the other one stays a
    rival that a suggestion has to be safe for. An event that does not know its gain says nothing of the kind, where
    others do.
    """
    every = [f.fit for f in usable if f.fit is not None]
    sure = [f.fit for f in usable if f.usable and f.fit is not None]
    kinds = Counter(f.process for f in sure or every)
    most = max(every, key=lambda f: (kinds[f.process], every.index(f))).process
    fits = [f for f in every if f.process == most]
    if len({math.copysign(1, f.gain) for f in every}) > 1:
        return None, "the events contradict each other in the sign of the gain"
    joint = combine(fits)
    if contradictory(fits, joint):
        why = goes_with([f for f in usable if f.fit in fits]) or "their gains differ beyond chance"
        return joint, f"the events contradict each other: {why}"
    return joint, ""
