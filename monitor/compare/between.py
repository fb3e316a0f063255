"""Two audits to what has changed between them, loop by loop."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

from monitor.adapters.audit_folder import AuditFolder
from monitor.contract.changes import MISSING, NEW, OUTCOMES, UNKNOWN, Comparison, LoopChange
from monitor.contract.records import by_loop

from .judge import judge

MOST_NAMED = 8
"""Columns that an earlier audit does not have, of which the note names so many."""


def compare(old: AuditFolder, new: AuditFolder) -> Comparison:
    """Compare two audits, the earlier one first; loops are one where they have one name."""
    rows = {row.loop: row for row in old.rows}
    events, spells = (by_loop(a.events) for a in (old, new)), (by_loop(a.spells) for a in (old, new))
    (events_old, events_new), (spells_old, spells_new) = events, spells
    loops = []
    for row in new.rows:
        name = row.loop
        before = rows.pop(name, None)
        if before is None:
            loops.append(LoopChange(name, NEW, UNKNOWN, "", "not in the earlier audit", after=row))
            continue
        loops.append(
            judge(
                (before, row),
                (events_old.get(name, ()), events_new.get(name, ())),
                (spells_old.get(name, ()), spells_new.get(name, ())),
            )
        )
    for name, before in rows.items():
        loops.append(LoopChange(name, MISSING, UNKNOWN, "", "not in the later audit", before=before))
    counts = Counter(change.outcome for change in loops)
    names = [[c.loop for c in loops if c.outcome == outcome] for outcome in (MISSING, NEW)]
    notes = [note for audit in (old, new) for note in _lacks(audit)]
    return Comparison(
        old.about,
        new.about,
        tuple(loops),
        {outcome: counts[outcome] for outcome in OUTCOMES},
        tuple(_renamed(*names)),
        tuple(notes),
    )


def _renamed(gone: Sequence[str], come: Sequence[str]) -> list[tuple[str, str]]:
    """Return pairs that look like one loop under two names: the same letters and digits, or one with more before them.

    Only where each has one such partner: nothing is guessed.
    """
    pairs = [(g, c) for g in gone for c in come if _look_alike(_bare(g), _bare(c))]
    times = Counter(name for pair in pairs for name in pair)
    return [pair for pair in pairs if times[pair[0]] == times[pair[1]] == 1]


def _bare(name: str) -> str:
    return "".join(c for c in name.casefold() if c.isalnum())


def _look_alike(one: str, other: str) -> bool:
    short, long = sorted((one, other), key=len)
    return bool(short) and long.endswith(short)


def _lacks(audit: AuditFolder) -> list[str]:
    """Say what an audit of an earlier version does not have."""
    if not audit.lacks:
        return []
    version = audit.about.get("versions", {}).get("loopsight", "")
    more = len(audit.lacks) - MOST_NAMED
    named = ", ".join(audit.lacks[:MOST_NAMED]) + (f" and {more} more" if more > 0 else "")
    return [f"{audit.path} (loopsight {version}): has no {named}: what rests on them is not compared"]
