"""The figures of one loop, before and after, each with what it says and whether that counts."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from statistics import median

from monitor.contract.changes import BETTER, COMPARED, SAME, UNCLEAR, WORSE, Change
from monitor.contract.records import LOAD, SETPOINT, Assessment, Spell

from .chance import Ratio, ratio_of_events, ratio_of_means
from .conditions import Condition

WORTH, WORTH_OF_MEANS = 1.1, 1.25
"""Ratios from which on a change is worth a word, however sure it is: of what events show, and of means over time, since
no two periods are loaded alike."""
ALIKE = 1.25
"""Ratio within which a figure is the same, if its interval lies within."""
FAST_ENOUGH, ROBUST_ENOUGH = 1.0, 2.0
"""An index at or above the reference, an Ms that is comfortable: what happens beyond is neither good nor bad."""
MOST_MS = 100.0
"""Ms that stands for an unstable loop: it has no ratio."""
UNIT_STEPS = ("iae_setpoint", "iae_load")
"""Figures that say in the plant's units what the index says against a reference; they count where that is not known."""


def changes_of(
    events: tuple[Sequence[Assessment], Sequence[Assessment]],
    spells: tuple[Sequence[Spell], Sequence[Spell]],
    conditions: Sequence[Condition],
) -> list[Change]:
    """Return the figures of one loop that are known before or after.

    Parameters
    ----------
    events, spells
        Of the loop, before and after.
    conditions
        In what noise, loads and steps differ: what that explains does not count.
    """
    found: dict[str, Change] = {}
    for name, value in _OF_EVENT.items():
        values = [[v for e in of if (v := value(e)) is not None and v > 0.0] for of in events]
        if any(values):
            found[name] = _change(name, _medians(values), _lengths(values), ratio_of_events(*values))
    for name in (n for n, c in COMPARED.items() if not c.from_events):
        means = [[(getattr(s, name), s.seconds) for s in of] for of in spells]
        if any(means):
            middle = [_mean(side) for side in means]
            found[name] = _change(name, middle, _lengths(means), ratio_of_means(*means))
    return [_counted(change, found, conditions) for change in found.values()]


def _of_kind(kind: str, name: str) -> Callable[[Assessment], float | None]:
    return lambda e: getattr(e, name) if e.kind == kind else None


def _unit_error(kind: str) -> Callable[[Assessment], float | None]:
    return lambda e: (
        e.iae / abs(e.amplitude) if e.kind == kind and e.iae is not None and e.amplitude else None
    )


_OF_EVENT: dict[str, Callable[[Assessment], float | None]] = {
    "ci_setpoint": _of_kind(SETPOINT, "ci"),
    "ci_load": _of_kind(LOAD, "ci"),
    "ms": lambda e: None if e.ms is None else min(e.ms, MOST_MS),
    "iae_setpoint": _unit_error(SETPOINT),
    "iae_load": _unit_error(LOAD),
}


def _medians(values: Sequence[Sequence[float]]) -> list[float | None]:
    return [median(v) if v else None for v in values]


def _lengths(values: Sequence[Sequence[object]]) -> tuple[int, int]:
    return len(values[0]), len(values[1])


def _mean(spells: Sequence[tuple[float, float]]) -> float | None:
    if not spells:
        return None
    return math.fsum(v * w for v, w in spells) / math.fsum(w for _, w in spells)


def _change(
    name: str, middle: Sequence[float | None], numbers: tuple[int, int], ratio: Ratio | None
) -> Change:
    says = _says(name, ratio)
    if name == "ms" and any(v is not None and v >= MOST_MS for v in middle):
        middle, ratio = [math.inf if v is not None and v >= MOST_MS else v for v in middle], None
    return Change(
        name,
        before=middle[0],
        after=middle[1],
        n_before=numbers[0],
        n_after=numbers[1],
        ratio=None if ratio is None else ratio.value,
        ratio_lo=None if ratio is None else ratio.low,
        ratio_hi=None if ratio is None else ratio.high,
        says=says,
        counts=False,
    )


def _says(name: str, ratio: Ratio | None) -> str:
    """Say what a ratio means: better or worse where it is sure and worth a word, the same where it is surely small."""
    if ratio is None:
        return UNCLEAR
    compared = COMPARED[name]
    sure = ratio.low > 1.0 or ratio.high < 1.0
    worth = WORTH if compared.from_events else WORTH_OF_MEANS
    if sure and not 1.0 / worth < ratio.value < worth:
        return BETTER if (ratio.value > 1.0) == (compared.sign > 0) else WORSE
    return SAME if ratio.low >= 1.0 / ALIKE and ratio.high <= ALIKE else UNCLEAR


def _counted(change: Change, others: dict[str, Change], conditions: Sequence[Condition]) -> Change:
    """Return a figure with whether it counts: what matters, is not said by another, and not explained by the loads."""
    known = [v for v in (change.before, change.after) if v is not None]
    if change.name.startswith("ci_"):
        counts = min(known) < FAST_ENOUGH
    elif change.name == "ms":
        counts = max(known) > ROBUST_ENOUGH
    elif change.name in UNIT_STEPS:
        index = others.get(change.name.replace("iae_", "ci_"))
        counts = index is None or index.ratio is None
    else:
        explained = any(c.harder == (change.says == WORSE) for c in conditions)
        counts = not explained and change.name != "op_path"
    return replace(change, counts=counts)
