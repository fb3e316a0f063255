"""One verdict and one action per loop: what its health says comes before what its events say.

The tree, from the root: Are the data trustworthy? Is the loop in control? Is it the valve? Does it oscillate for
another reason? Only then: how is it tuned?
"""

from __future__ import annotations

from dataclasses import fields

from .health import Health
from .records import NOT_ASSESSED, LoopRow


def conclude(row: LoopRow, health: Health) -> LoopRow:
    """Write health into the row, and let it overrule the events' verdict where it comes first; return the row."""
    for f in fields(health):
        setattr(row, f.name, getattr(health, f.name))
    manual = health.manual is not None and health.manual > 0.5
    row.flags = ("manual",) if manual else ()
    if row.verdict == NOT_ASSESSED:
        row.reason = (
            "no good sample was seen"
            if health.coverage is None
            else "in manual"
            if manual
            else "no set-point or load step was seen"
        )
        row.action = "none; a set-point step shows how the loop is tuned"
    return row
