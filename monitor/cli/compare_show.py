"""What a comparison shows on the terminal: what got worse, what improved, and what follows."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

from rich.console import Console
from rich.table import Table
from rich.text import Text

from monitor.contract.changes import BETTER, MISSING, MIXED, NEW, SAME, UNCLEAR, WORSE, Comparison, LoopChange
from monitor.contract.text import visible

SHOWN_LOOPS = 15
"""Of each kind on the terminal; the files have all."""
SHOWN_NAMES = 6
_STYLES = {WORSE: "bold red", MIXED: "yellow", BETTER: "green"}


def show(found: Comparison, files: Sequence[Path]) -> None:
    """Print what could not be compared (stderr), what has changed, and where the files are."""
    console = Console(width=None if sys.stdout.isatty() else 140, highlight=False)
    errors = Console(stderr=True, highlight=False, soft_wrap=True)
    for note in found.notes:
        errors.print(Text(visible(note)))
    changed = [(outcome, found.of(outcome)) for outcome in (WORSE, MIXED, BETTER)]
    if any(loops for _, loops in changed):
        console.print(_table(changed))
    for outcome, loops in changed:
        if len(loops) > SHOWN_LOOPS:
            console.print(f"... and {len(loops) - SHOWN_LOOPS} more {outcome}, in {files[1].name}")
    c = found.counts
    console.print(
        f"{found.shared} loops in both: {c[BETTER]} better, {c[WORSE]} worse, {c[MIXED]} better in one and worse in "
        f"another, {c[SAME]} as before, {c[UNCLEAR]} cannot be told.",
        soft_wrap=True,
    )
    for outcome, words in ((NEW, "new"), (MISSING, "missing")):
        if c[outcome]:
            console.print(
                Text(f"{c[outcome]} {words}: {_names([x.loop for x in found.of(outcome)])}"), soft_wrap=True
            )
    if found.renamed:
        pairs = _names([f"{old} → {new}" for old, new in found.renamed])
        console.print(Text(f"{len(found.renamed)} look renamed: {pairs}"), soft_wrap=True)
    console.print(Text(f"{files[0].parent}/: {', '.join(f.name for f in files)}"), soft_wrap=True)


def _names(names: Sequence[str]) -> str:
    more = len(names) - SHOWN_NAMES
    return ", ".join(visible(n, 80) for n in names[:SHOWN_NAMES]) + (f" and {more} more" if more > 0 else "")


def _table(changed: Sequence[tuple[str, Sequence[LoopChange]]]) -> Table:
    table = Table(box=None, pad_edge=False, header_style="bold")
    table.add_column("", no_wrap=True)
    table.add_column("loop", no_wrap=True)
    for heading in ("what has changed", "settings", "what follows"):
        table.add_column(heading, ratio=1)
    for outcome, loops in changed:
        for loop in loops[:SHOWN_LOOPS]:
            signs = [*(f"− {w}" for w in loop.worse), *(f"+ {w}" for w in loop.better)]
            table.add_row(
                Text(outcome, _STYLES[outcome]),
                Text(visible(loop.loop, 80)),
                Text("\n".join(signs)),
                Text(visible(loop.settings_words)),
                Text(visible(loop.conclusion)),
            )
    return table
