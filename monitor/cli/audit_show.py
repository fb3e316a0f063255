"""What an audit shows on the terminal: a bar while it runs, the worst loops when it is done."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import BarColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn
from rich.table import Table
from rich.text import Text

from monitor.audit.result import AuditResult
from monitor.audit.tasks import Progress as State
from monitor.contract.records import GOOD, INCONCLUSIVE, NOT_ASSESSED, RETUNE, LoopRow
from monitor.contract.text import visible

SHOWN_LOOPS = 20
"""Loops on the terminal; the files have all."""
_STYLES = {RETUNE: "bold red", INCONCLUSIVE: "yellow", GOOD: "green", NOT_ASSESSED: "dim"}


@contextmanager
def progress_bar() -> Iterator[Callable[[State], None]]:
    """Yield what draws an audit's progress: a bar on a terminal, nothing elsewhere."""
    console = Console(stderr=True)
    if not console.is_terminal:
        yield lambda _: None
        return
    columns = (SpinnerColumn(), TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn())
    with Progress(*columns, console=console, transient=True) as bar:
        work = bar.add_task("reading", total=None)
        began = time.monotonic()

        def draw(state: State) -> None:
            seconds = max(time.monotonic() - began, 1e-3)
            speed = state.rows / seconds
            left = max(state.all_rows - state.rows, 0) / speed if speed else 0.0
            bar.update(
                work,
                completed=min(state.rows, state.all_rows),
                total=state.all_rows or None,
                description=f"{state.rows / 1e6:.1f} M rows  {speed / 1e6:.2f} M/s  "
                f"{state.loops}/{state.all_loops} loops  {left:.0f} s left",
            )

        yield draw


def show(result: AuditResult) -> None:
    """Print what was left out (stderr), the worst loops, and where the files are."""
    console = Console(width=None if sys.stdout.isatty() else 140, highlight=False)
    errors = Console(stderr=True, highlight=False, soft_wrap=True)
    for line in [*result.notes, *result.problems]:
        errors.print(Text(visible(line)))
    if result.exit_code:
        return
    if result.rows:
        console.print(_table(result.rows[:SHOWN_LOOPS]))
        if len(result.rows) > SHOWN_LOOPS:
            console.print(f"... and {len(result.rows) - SHOWN_LOOPS} more in {result.files[0].name}")
    c = result.counts
    console.print(
        f"{c['loops']} loops, {c['events']} events, {c['ok']} of {c['rows']} samples used: "
        f"{c['loops_retune']} to retune, {c['loops_inconclusive']} inconclusive, "
        f"{c['loops_good']} good, {c['loops_not_assessed']} not assessed.",
        soft_wrap=True,
    )
    folder = result.files[0].parent
    tables = [f for f in result.files if f.suffix == ".parquet"]
    others = sorted({f.name for f in result.files} - {f.name for f in tables}, key=_as_read)
    console.print(Text(f"{folder}/: {', '.join(others)}, {len(tables)} .parquet"), soft_wrap=True)


def _as_read(name: str) -> tuple[bool, bool, str]:
    """Sort key of files: the report first, what is said of the audit last."""
    return name != "report.html", name == "audit.json", name


def _table(rows: list[LoopRow]) -> Table:
    table = Table(box=None, pad_edge=False, header_style="bold")
    for heading, justify in (("verdict", "left"), ("loop", "left"), ("CI", "right"), ("Ms", "right")):
        table.add_column(heading, justify=justify, no_wrap=True)  # type: ignore[arg-type]
    table.add_column("why", ratio=1)
    table.add_column("new settings", max_width=44)
    for row in rows:
        table.add_row(
            Text(row.verdict, _STYLES.get(row.verdict, "")),
            Text(visible(row.loop, 80)),
            _figure(row.ci_setpoint if row.ci_setpoint is not None else row.ci_load),
            _figure(row.ms),
            Text(row.reason),
            Text(row.action if row.new_kp is not None else ""),
        )
    return table


def _figure(value: float | None) -> str:
    return "" if value is None else f"{value:.2f}"
