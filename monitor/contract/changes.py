"""What two audits of the same loops, before and after, come to: plain facts, for tables, terminal and pages."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

from .records import LoopRow

WORSE, MIXED, BETTER, UNCLEAR, SAME, NEW, MISSING = (
    *("worse", "mixed", "better", "cannot_tell", "same", "new", "missing"),
)
OUTCOMES = (WORSE, MIXED, BETTER, UNCLEAR, SAME, NEW, MISSING)
"""Of a loop, in the order of a reader; of a figure ``worse``, ``better``, ``cannot_tell`` or ``same``."""
RETUNED, KEPT, UNKNOWN = "retuned", "kept", "unknown"
"""What became of a loop's settings."""


LEVEL = 0.99
"""Of the intervals of changes: some six figures of a loop are looked at, and at 95 % one loop in four that nothing has
happened to would be called changed."""


class Compared(NamedTuple):
    """What is compared of a figure."""

    unit: str
    short: str
    words: str
    sign: int
    """1 where more is better, -1 where less is."""
    from_events: bool
    """Chance is told by the scatter of its events; otherwise by that of spells of time."""


COMPARED: dict[str, Compared] = {
    "ci_setpoint": Compared("-", "CI_sp", "index after set-point steps", 1, True),
    "ci_load": Compared("-", "CI_ld", "index after load steps", 1, True),
    "ms": Compared("-", "Ms", "peak sensitivity", -1, True),
    "iae_setpoint": Compared("s", "IAE_sp", "error after a set-point step of 1, IAE", -1, True),
    "iae_load": Compared("PV s/OP", "IAE_ld", "error after a load step of 1, IAE", -1, True),
    "error": Compared("PV", "mean error", "mean size of the error", -1, False),
    "error_rms": Compared("PV", "variability", "variability of PV about its set point, RMS", -1, False),
    "op_path": Compared("OP/h", "way of OP", "way of OP with every move", -1, False),
}
"""By figure, in the order of a reader."""


@dataclass(frozen=True, slots=True)
class Change:
    """One figure of a loop, before and after."""

    name: str
    """One of `COMPARED`."""
    before: float | None
    after: float | None
    n_before: int
    """Events, or spells of time."""
    n_after: int
    ratio: float | None
    """After over before; None where too few values tell it."""
    ratio_lo: float | None
    ratio_hi: float | None
    """Ends of the interval of the ratio."""
    says: str
    """``better``, ``worse``, ``same`` or ``cannot_tell``."""
    counts: bool
    """Whether it counts for the loop's outcome."""


@dataclass(frozen=True, slots=True)
class LoopChange:
    """One loop, before and after."""

    loop: str
    outcome: str
    """One of `OUTCOMES`."""
    settings: str
    """`RETUNED`, `KEPT` or `UNKNOWN`."""
    settings_words: str
    """Settings of before and of now, and from where they are known."""
    conclusion: str
    """What to do, in plain words."""
    better: tuple[str, ...] = ()
    worse: tuple[str, ...] = ()
    """What is, in words with figures."""
    conditions: str = ""
    """In what loads, noise and time in control differ much between the two; empty where they do not."""
    changes: tuple[Change, ...] = ()
    before: LoopRow | None = None
    after: LoopRow | None = None


@dataclass(frozen=True, slots=True)
class Comparison:
    """Two audits, before and after."""

    before: Mapping[str, Any]
    """``audit.json`` of each."""
    after: Mapping[str, Any]
    loops: tuple[LoopChange, ...]
    """In the order of the later audit, the worst first; after them those that it has not."""
    counts: Mapping[str, int]
    """Loops by outcome."""
    renamed: tuple[tuple[str, str], ...]
    """Loops that look renamed: the old name, the new one."""
    notes: tuple[str, ...]
    """What could not be compared, and why."""

    @property
    def shared(self) -> int:
        """Number of loops that both audits have."""
        return len(self.loops) - self.counts[NEW] - self.counts[MISSING]

    def of(self, *outcomes: str) -> list[LoopChange]:
        """Return the loops of these outcomes, in their order."""
        return [change for change in self.loops if change.outcome in outcomes]
