"""Two folders of audits to the tables and the page of what has changed."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from monitor.adapters.audit_folder import read_audit
from monitor.adapters.files import write_text
from monitor.adapters.tables import csv_text, write_parquet
from monitor.contract.changes import COMPARED, Change, Comparison, LoopChange
from monitor.report.changes import draw_changes

from .between import compare

COMPARE_FILE, COMPARE_CSV_FILE, COMPARE_HTML_FILE = "compare.parquet", "compare.csv", "compare.html"
BOTH = ("oscillating_share", "saturation", "manual", "dead_band", "noise", "coverage")
"""Figures of health that stand beside each other, without an interval."""


def run_compare(old: str | Path, new: str | Path, out: str | Path) -> tuple[Comparison, list[Path]]:
    """Compare two audits; return what has changed, and the files that were written.

    Parameters
    ----------
    old, new
        Folders of audits, the earlier one first.
    out
        Folder; is made where it does not exist.

    Raises
    ------
    ValueError
        A folder holds no audit, or the two share no loop: one line that says so.
    OSError
        A file cannot be read or written.
    """
    found = compare(read_audit(Path(old)), read_audit(Path(new)))
    if not found.shared:
        pairs = ", ".join(f"{a} → {b}" for a, b in found.renamed[:3])
        hint = f"; some look renamed: {pairs}" if pairs else ""
        raise ValueError(f"{old}, {new}: no loop is in both{hint}, expected two audits of the same loops")
    folder = Path(out)
    folder.mkdir(parents=True, exist_ok=True)
    table = columns_of(found)
    files = [folder / name for name in (COMPARE_HTML_FILE, COMPARE_CSV_FILE, COMPARE_FILE)]
    write_text(files[0], draw_changes(found))
    write_text(files[1], csv_text(table))
    write_parquet(files[2], table)
    return found, files


Column = tuple[str, list[Any]]


def columns_of(found: Comparison) -> dict[str, Column]:
    """Return ``compare.parquet``: heading to (kind, values), one row per loop."""
    loops = found.loops
    names = {**dict(found.renamed), **{new: old for old, new in found.renamed}}

    def texts(value: Callable[[LoopChange], str]) -> Column:
        return "str", [value(c) for c in loops]

    table: dict[str, Column] = {
        "loop": texts(lambda c: c.loop),
        "outcome": texts(lambda c: c.outcome),
        "settings": texts(lambda c: c.settings),
        "settings_words": texts(lambda c: c.settings_words),
        "conclusion": texts(lambda c: c.conclusion),
        "better": ("list", [list(c.better) for c in loops]),
        "worse": ("list", [list(c.worse) for c in loops]),
        "conditions": texts(lambda c: c.conditions),
        "looks_renamed": texts(lambda c: names.get(c.loop, "")),
        "verdict_before": texts(lambda c: c.before.verdict if c.before else ""),
        "verdict_after": texts(lambda c: c.after.verdict if c.after else ""),
        "flags_before": ("list", [list(c.before.flags) if c.before else [] for c in loops]),
        "flags_after": ("list", [list(c.after.flags) if c.after else [] for c in loops]),
    }
    for name in COMPARED:
        table |= _of_figure(name, [next((f for f in c.changes if f.name == name), None) for c in loops])
    for name in ("kp", "ti", "td", *BOTH):
        for side in ("before", "after"):
            rows = (getattr(c, side) for c in loops)
            table[f"{name}_{side}"] = "float", [None if row is None else getattr(row, name) for row in rows]
    return table


def _of_figure(name: str, changes: Sequence[Change | None]) -> dict[str, Column]:
    """Return the columns of one figure."""
    kinds = {"before": "float", "after": "float", "ratio": "float", "ratio_lo": "float", "ratio_hi": "float"}
    kinds |= {"n_before": "int", "n_after": "int", "says": "str"}
    return {
        f"{name}_{field}": (kind, [None if c is None else getattr(c, field) for c in changes])
        for field, kind in kinds.items()
    }
