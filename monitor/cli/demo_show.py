"""What the demo shows on a terminal."""

from __future__ import annotations

from contextlib import AbstractContextManager

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from monitor.contract.records import INCONCLUSIVE, RETUNE, Assessment, LoopRow, Record, Suggestion
from monitor.contract.status import Status

_YOUR_OWN = (
    "With data of your own: [bold]loopsight audit EXPORT --out audit[/] reads what a historian exports and writes "
    "report.html;\n[bold]loopsight import EXPORT --out import[/] says how it was read, "
    "[bold]loopsight monitor --help[/] how to watch a plant live."
)
COLOURS = {"retune": "bold red", "inconclusive": "yellow", "good": "green", "not_assessed": "dim"}


class DemoConsole:
    """Prints verdicts that are new and suggestions as they come, and every few seconds how things stand."""

    def __init__(self) -> None:
        self._console = Console(highlight=False)
        self._verdicts: dict[str, str] = {}

    def preparing(self) -> AbstractContextManager[object]:
        """Say inside that the first run takes a while."""
        return self._console.status("preparing the fits (the first run compiles them, two or three minutes)")

    def view(self, address: str) -> None:
        """Say where the picture is."""
        self._line(f"[bold]view[/]   open {address}")

    def ready(self, loops: int, endpoint: str) -> None:
        """Say that it runs."""
        self._line(f"[bold]ready[/]  {loops} loops at {endpoint}   (Ctrl-C ends)")

    def heard(self, record: Record) -> None:
        """Print a verdict that is another than the loop's last one, or a suggestion.

        An event that says nothing takes no verdict back: that is news of a loop only where there was none.
        """
        if isinstance(record, Assessment):
            last = self._verdicts.get(record.loop)
            if last != record.verdict and (last is None or record.verdict != INCONCLUSIVE):
                self._verdicts[record.loop] = record.verdict
                self._line(_verdict(record))
        elif isinstance(record, Suggestion):
            row = record.row
            worst = "" if row.new_ms is None else f"Ms {row.new_ms:.2f}, at worst {row.new_ms_worst:.2f}"
            self._line(f"  {escape(row.loop):<9} [bold cyan]suggestion[/]    {row.action}  [dim]({worst})[/]")

    def progress(self, status: Status, passed: float, seconds: float | None) -> None:
        """Say how things stand after so long, of so long [s]."""
        loops = status.loops
        left = "" if seconds is None else f" of {seconds:.0f}"
        self._line(
            f"[dim]{passed:4.0f}{left} s   {status.samples_ok:,} samples, {status.rates.samples:.0f}/s   "
            f"{loops.total} loops: {loops.retune} retune, {loops.good} good, {loops.inconclusive} inconclusive, "
            f"{loops.not_assessed} not assessed, {loops.open} events open[/]"
        )

    def summary(self, rows: list[LoopRow]) -> None:
        """List the loops, worst first, as a plant engineer would."""
        table = Table(title="Loops, worst first", title_justify="left", box=SIMPLE_HEAD)
        table.add_column("loop", no_wrap=True)
        table.add_column("verdict", no_wrap=True)
        for name in ("CI_sp", "Ms", "T0 [s]"):
            table.add_column(escape(name), justify="right", no_wrap=True)
        table.add_column("what to do", ratio=1)
        for row in rows:
            table.add_row(
                escape(row.loop),
                f"[{COLOURS[row.verdict]}]{row.verdict}[/]",
                *(_figure(value) for value in (row.ci_setpoint, row.ms, row.t0)),
                escape(row.action if row.verdict == RETUNE else row.reason),
            )
        self._console.print(table)
        self._line(_YOUR_OWN)

    def _line(self, text: str) -> None:
        self._console.print(text, soft_wrap=True)


def _verdict(record: Assessment) -> str:
    ci = "" if record.ci is None else f"CI_sp {record.ci:.2f}"
    ms = "" if record.ms is None else f"Ms {record.ms:.2f}"
    return (
        f"  {escape(record.loop):<9} [{COLOURS[record.verdict]}]{record.verdict:<13}[/] {ci:<10}  {ms:<8}  "
        f"[dim]{escape(record.reason)}[/]"
    )


def _figure(value: float | None) -> str:
    return "" if value is None else f"{value:.3g}"
