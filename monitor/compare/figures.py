"""The figures of one loop, before and after, each with what it says and whether that counts."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from statistics import median

from monitor.contract.changes import BETTER, COMPARED, SAME, UNCLEAR, WORSE, Change
from monitor.contract.records import LOAD, SETPOINT, Assessment, Spell

from .chance import Ratio, ratio_of_events, ratio_of_means

WORTH = 1.1
"""Ratio from which on a change is worth a word, however sure it is."""
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
    *,
    alike: bool,
) -> list[Change]:
    """Return the figures of one loop that are known before or after.

    Parameters
    ----------
    events, spells
        Of the loop, before and after.
    alike
        Whether noise, loads and steps were about the same: what depends on them counts only then.
    """
    found: dict[str, Change] = {}
    for name, value in _OF_EVENT.items():
        values = [[v for e in of if (v := value(e)) is not None and v > 0.0] for of in events]
        if any(values):
            found[name] = _change(name, _medians(values), _lengths(values), ratio_of_events(*values))
    for name in (n for n, c in COMPARED.items() if not c.from_events):
        means = [[getattr(s, name) for s in of] for of in spells]
        weights = [[s.seconds for s in of] for of in spells]
        if any(means):
            ratio = ratio_of_means(means[0], weights[0], means[1], weights[1])
            middle = [_mean(m, w) for m, w in zip(means, weights, strict=True)]
            found[name] = _change(name, middle, _lengths(means), ratio)
    return [_counted(change, found, alike=alike) for change in found.values()]


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


def _lengths(values: Sequence[Sequence[float]]) -> tuple[int, int]:
    return len(values[0]), len(values[1])


def _mean(values: Sequence[float], weights: Sequence[float]) -> float | None:
    return (
        math.fsum(v * w for v, w in zip(values, weights, strict=True)) / math.fsum(weights)
        if values
        else None
    )


def _change(
    name: str, middle: Sequence[float | None], numbers: tuple[int, int], ratio: Ratio | None
) -> Change:
    if name == "ms":
        middle = [math.inf if v is not None and v >= MOST_MS else v for v in middle]
    value, low, high = (None, None, None) if ratio is None else ratio
    return Change(name, *middle, *numbers, value, low, high, _says(name, ratio), counts=False)


def _says(name: str, ratio: Ratio | None) -> str:
    """Say what a ratio means: better or worse where it is sure and worth a word, the same where it is surely small."""
    if ratio is None:
        return UNCLEAR
    sure = ratio.low > 1.0 or ratio.high < 1.0
    if sure and not 1.0 / WORTH < ratio.value < WORTH:
        return BETTER if (ratio.value > 1.0) == (COMPARED[name].sign > 0) else WORSE
    return SAME if 1.0 / ALIKE <= ratio.low and ratio.high <= ALIKE else UNCLEAR


def _counted(change: Change, others: dict[str, Change], *, alike: bool) -> Change:
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
        counts = alike and change.name != "op_path"
    return replace(change, counts=counts)
