"""With what the gains of a loop's events go, where they differ beyond chance: the side of OP, or the level of PV.

An output that heats on one side and cools on the other, a valve that does nothing below its least opening, a vessel
that is wider in the middle: each shows one gain on one side of some value, and another one beyond it. Found is the
value that splits the events into two groups, each of one gain (derived).
"""

from __future__ import annotations

import math
from itertools import pairwise

from monitor.assess.event import Finding
from monitor.identify.fit import Fit, combine, contradictory

OP, PV = 0, 1
"""Places of the signals in a finding's levels."""
NAMES = ("OP", "PV")
WHY = {
    OP: (
        "a split range, a valve whose gain is not constant, or an output without effect on one side; settings for the "
        "larger gain are safe on both"
    ),
    PV: "the process differs with its level; settings have to hold for the larger gain",
}
"""What a gain that goes with a signal comes from, and what follows; the likelier first."""
LEAST_RATIO = 1.3
"""Of the two sides' gains, below which they are one."""
LEAST_EVENTS = 3
"""Without which two gains are two events, and anything may have come between them."""
LEAST_SHARE = 0.6
"""Of the events, that lie on either side and do not cross the value."""


def goes_with(findings: list[Finding]) -> str:
    """Say on what side of OP, or at what level of PV, a loop has which gain; empty where neither splits its events.

    Parameters
    ----------
    findings
        Of one loop, of one kind of process, each with a model.
    """
    for signal, why in WHY.items():
        split = _split(findings, signal)
        if split is not None:
            at, low, high = split
            return f"the gain is {low:.2g} with {NAMES[signal]} below {at:.3g} and {high:.2g} above: {why}"
    return ""


def _split(findings: list[Finding], signal: int) -> tuple[float, float, float] | None:
    """Return the value between two groups of one gain each, and the gain below and above it; None without one."""
    levels = [f.levels[signal] for f in findings]
    middles = sorted(0.5 * (low + high) for low, high in levels)
    best: tuple[float, float, float] | None = None
    for one, other in pairwise(middles):
        at = 0.5 * (one + other)
        both = zip(findings, levels, strict=True)
        sides: tuple[list[Fit], list[Fit]] = [], []
        for finding, (low, high) in both:
            if finding.fit is not None and not low < at < high:  # one that crosses it shows something between
                sides[low >= at].append(finding.fit)
        seen = len(sides[0]) + len(sides[1])
        if not all(sides) or seen < max(LEAST_EVENTS, LEAST_SHARE * len(findings)):
            continue
        below, above = (combine(fits) for fits in sides)
        if any(contradictory(fits, one) for fits, one in zip(sides, (below, above), strict=True)):
            continue
        ratio = abs(math.log(below.gain / above.gain)) if below.gain * above.gain > 0 else 0.0
        if ratio >= math.log(LEAST_RATIO) and (best is None or ratio > abs(math.log(best[1] / best[2]))):
            best = at, below.gain, above.gain
    return best
