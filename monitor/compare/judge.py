"""One loop, before and after: improved or worse, and what follows, by whether it was retuned in between."""

from __future__ import annotations

import math
from collections.abc import Sequence

from monitor.contract.changes import (
    BETTER,
    COMPARED,
    KEPT,
    MIXED,
    RETUNED,
    SAME,
    UNCLEAR,
    UNKNOWN,
    WORSE,
    Change,
    LoopChange,
)
from monitor.contract.danger import FAULTS
from monitor.contract.records import GOOD, RETUNE, Assessment, LoopRow, Spell

from .conditions import Condition, conditions_of, process_change
from .figures import changes_of
from .settings import SettingsChange, settings_change, way_back

NEAR = "near_instability"
SERIOUS = (NEAR, *sorted(FAULTS), "manual")
"""Flags that a loop is worse with and better without, whatever its figures."""
LOOK_AT = {
    "stiction": "look at the valve",
    "no_response": "look at the valve",
    "stuck_pv": "look at the transmitter",
    "manual": "ask the operators why it is in manual",
    "oscillating": "find where the cycle comes from",
    "saturated": "look for the bottleneck",
}
"""By flag that has come, the likeliest cause first."""


def judge(
    rows: tuple[LoopRow, LoopRow],
    events: tuple[Sequence[Assessment], Sequence[Assessment]],
    spells: tuple[Sequence[Spell], Sequence[Spell]],
) -> LoopChange:
    """Return what has become of a loop; rows, events and spells of it before and after."""
    before, after = rows
    conditions = conditions_of(rows, events, spells)
    changes = changes_of(events, spells, conditions)
    settings = settings_change(before, after)
    better, worse = _signs(rows, [c for c in changes if COMPARED[c.name].from_events])
    errors = _told([c for c in changes if not COMPARED[c.name].from_events])
    # a mean over time is of the loads as well as of the loop: it speaks where a retune is what has changed
    if better or worse or settings.state == RETUNED:
        better, worse = better + errors[0], worse + errors[1]
    outcome = _outcome(rows, bool(better), bool(worse), changes, any(errors))
    parts = [_conclusion(outcome, settings, rows)]
    if outcome == UNCLEAR and not any(errors):
        parts.append(_why_unclear(changes))
    if outcome == UNCLEAR and any(errors):
        parts.append(
            f"{'; '.join(errors[0] + errors[1])}: loop or loads, which of the two the events do not tell"
        )
    if settings.state != RETUNED and outcome in (WORSE, MIXED, BETTER):
        parts.append(_cause(rows, outcome, conditions))
    return LoopChange(
        after.loop,
        outcome,
        settings.state,
        settings.words,
        "; ".join(filter(None, parts)),
        tuple(better),
        tuple(worse),
        "; ".join(c.words for c in conditions),
        tuple(changes),
        before,
        after,
    )


def _signs(rows: tuple[LoopRow, LoopRow], changes: Sequence[Change]) -> tuple[list[str], list[str]]:
    """Return what is better and what is worse, in words."""
    before, after = rows
    better = [f.replace("_", " ") + " no more" for f in SERIOUS if f in before.flags and f not in after.flags]
    worse = [f.replace("_", " ") + " now" for f in SERIOUS if f in after.flags and f not in before.flags]
    if (before.verdict, after.verdict) == (RETUNE, GOOD):
        better.append("to retune no more")
    if (before.verdict, after.verdict) == (GOOD, RETUNE):
        worse.append("to retune now")
    told = _told(changes)
    return better + told[0], worse + told[1]


def _told(changes: Sequence[Change]) -> tuple[list[str], list[str]]:
    """Return those figures that count, in words: the better ones, the worse ones."""
    better, worse = ([_words(c) for c in changes if c.counts and c.says == says] for says in (BETTER, WORSE))
    return better, worse


def _words(change: Change) -> str:
    """Say a change with its figures."""
    compared = COMPARED[change.name]
    unit = f" [{compared.unit}]" if compared.unit != "-" else ""
    before, after = ("unstable" if v == math.inf else f"{v:.3g}" for v in (change.before, change.after))
    return f"{compared.words} {before} → {after}{unit}"


def _outcome(
    rows: tuple[LoopRow, LoopRow], better: bool, worse: bool, changes: Sequence[Change], errors: bool
) -> str:
    """Return what all signs come to; from instability or towards it outweighs the rest."""
    near = [NEAR in row.flags for row in rows]
    if near[0] != near[1]:
        return WORSE if near[1] else BETTER
    if better or worse:
        return MIXED if better and worse else BETTER if better else WORSE
    told = {c.says for c in changes if COMPARED[c.name].from_events or c.counts} - {UNCLEAR}
    return SAME if told and not errors else UNCLEAR


_CONCLUSIONS = {
    (BETTER, RETUNED): "retuned and better: keep the new settings",
    (BETTER, KEPT): "better, though not retuned",
    (BETTER, UNKNOWN): "better; whether it was retuned is not known",
    (WORSE, RETUNED): "retuned and worse: go back to {back}",
    (WORSE, KEPT): "not retuned, worse by itself",
    (WORSE, UNKNOWN): "worse; whether it was retuned is not known",
    (MIXED, RETUNED): "retuned, better in one and worse in another: weigh them, or go back to {back}",
    (MIXED, KEPT): "not retuned, better in one and worse in another",
    (MIXED, UNKNOWN): "better in one and worse in another; whether it was retuned is not known",
    (SAME, RETUNED): "retuned, and as good or bad as before",
    (SAME, KEPT): "as before",
    (SAME, UNKNOWN): "as before",
    (UNCLEAR, RETUNED): "retuned; whether that helped cannot be told yet",
    (UNCLEAR, KEPT): "not retuned; cannot tell",
    (UNCLEAR, UNKNOWN): "cannot tell",
}


def _conclusion(outcome: str, settings: SettingsChange, rows: tuple[LoopRow, LoopRow]) -> str:
    before, after = rows
    back = way_back(before)
    if NEAR in before.flags:
        back = f"something between: {back} was near instability"
    said = _CONCLUSIONS[outcome, settings.state].format(back=back)
    if settings.state == RETUNED and outcome in (WORSE, MIXED) and after.new_kp is not None:
        said += "; what the later audit suggests is the way on"
    if settings.as_suggested:
        said = said.replace("retuned", "retuned as suggested", 1)
    if settings.state == KEPT and before.new_kp is not None and outcome != BETTER:
        said += "; the settings that were suggested are not in"
    return said


def _why_unclear(changes: Sequence[Change]) -> str:
    """Say what keeps a change from being told."""
    events = [c for c in changes if COMPARED[c.name].from_events]
    if not changes:
        return "no event, and no time watched in automatic, in both"
    if all(c.ratio is None for c in events):
        seen = max(events, key=lambda c: min(c.n_before, c.n_after), default=None)
        numbers = f"{seen.n_before} and {seen.n_after}" if seen else "none"
        return f"too few events before and after ({numbers}; 5 and 5 of a kind tell)"
    return "the scatter is larger than what has changed"


def _cause(rows: tuple[LoopRow, LoopRow], outcome: str, conditions: Sequence[Condition]) -> str:
    """Say what may be behind a change that no retune explains."""
    before, after = rows
    process = process_change(before, after)
    come = [words for flag, words in LOOK_AT.items() if flag in after.flags and flag not in before.flags]
    if come and outcome != BETTER:
        return come[0]
    if process:
        return process
    gone = [flag.replace("_", " ") for flag in LOOK_AT if flag in before.flags and flag not in after.flags]
    if gone and outcome == BETTER:
        return f"{gone[0]} is seen no more: repaired, or not excited?"
    if conditions:
        return "other conditions may be the cause"
    return "valve, process or load has changed: stroke the valve first" if outcome != BETTER else ""
