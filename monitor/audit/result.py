"""``loopsight audit``: a fleet's historian exports in, verdicts and settings out.

Importing this module is cheap; what the audit needs is imported where it runs.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

if TYPE_CHECKING:
    from monitor.contract.records import Assessment, LoopRow

    from .tasks import Progress

PARTS = ".parts"
"""Folder in DIR for what is done of an audit that is not."""


@dataclass(slots=True)
class AuditResult:
    """What an audit found, and where it is."""

    exit_code: int
    """0 where something was audited, 2 where nothing was usable."""
    problems: list[str] = field(default_factory=list)
    """What was left out, one line each: ``file[:line]: reason``."""
    rows: list[LoopRow] = field(default_factory=list)
    """Worst first."""
    events: list[Assessment] = field(default_factory=list)
    files: list[Path] = field(default_factory=list)
    counts: dict[str, Any] = field(default_factory=dict)


def run_audit(
    paths: Sequence[str | Path],
    loops_file: str | Path | None,
    out: str | Path,
    *,
    jobs: int = 1,
    since: str | None = None,
    until: str | None = None,
    tz: str | None = None,
    time_unit: str | None = None,
    resume: bool = False,
    scheduler: str | None = None,
    progress: Callable[[Progress], None] = lambda _: None,
) -> AuditResult:
    """Audit historian exports and write the tables and ``audit.json`` to ``out``.

    Parameters
    ----------
    paths
        Files, folders and globs.
    loops_file
        Loop table; None: every loop in the data, with defaults.
    jobs
        Processes. Their number changes nothing in the result.
    since, until
        First time, and first time not wanted any more: ISO text, or seconds where the data have numbers.
    tz
        Zone of times that name none; default UTC.
    time_unit
        Unit of numeric times: ``s``, ``ms``, ``us``, ``ns`` or ``excel``; default: told by their range.
    resume
        Take over what an earlier audit of the same data, stopped half way, has stored in ``out``.
    scheduler
        Address of a Dask scheduler that runs the tasks; its workers see the files under the same paths.

    Raises
    ------
    ValueError
        A setting is not acceptable: one line that names it.
    OSError
        ``out`` cannot be written to.
    """
    from .run import Audit  # noqa: PLC0415 (numba, pandas, pyarrow)

    audit = Audit(Path(out), tz=tz, since=since, until=until, time_unit=time_unit)
    audit.find(paths, loops_file)
    audit.run(jobs=jobs, resume=resume, scheduler=scheduler, progress=progress)
    return audit.finish()


_HELP = """Audit a fleet from historian exports.

PATH is a Parquet or CSV file, a folder or a glob: one long table (loop, time, sp, pv, op), a file per loop,
or a wide table (time, LIC-101.SP, LIC-101.PV, LIC-101.OP, ...). DIR receives loops.csv and loops.parquet
(a row per loop, worst first), events.parquet and audit.json.

\b
Example:
  loopsight audit 'export/*.parquet' --loops loops.csv --out audit --jobs 4
"""


@click.command("audit", help=_HELP)
@click.argument("paths", nargs=-1, required=True, metavar="PATH...")
@click.option(
    "--loops",
    "loops_file",
    metavar="FILE",
    help="Loop table. Default: all loops in the data, unknown settings.",
)
@click.option("--out", required=True, metavar="DIR", help="Folder for the results.")
@click.option("--jobs", default=1, show_default=True, type=click.IntRange(1, 1024), help="Processes.")
@click.option(
    "--since", metavar="TIME", help="Leave out what is earlier (ISO; seconds where the data have numbers)."
)
@click.option("--until", metavar="TIME", help="Leave out this time and what is later.")
@click.option("--tz", metavar="ZONE", help="Zone of times that name none, e.g. Europe/Berlin. Default: UTC.")
@click.option(
    "--time-unit",
    type=click.Choice(["s", "ms", "us", "ns", "excel"]),
    help="Unit of numeric times. Default: told by their range.",
)
@click.option("--resume", is_flag=True, help="Go on with an audit of the same data that was stopped.")
@click.option("--scheduler", metavar="ADDRESS", help="Run on this Dask cluster, e.g. tcp://10.0.0.5:8786.")
def audit_command(**options: Any) -> None:
    """Audit, show what was found, exit 0 or 2."""
    from monitor.cli.audit import progress_bar, show  # noqa: PLC0415 (rich)

    try:
        with progress_bar() as progress:
            result = run_audit(**options, progress=progress)
    except (ValueError, OSError, ImportError) as error:
        click.echo(f"loopsight audit: {error}", err=True)
        sys.exit(2)
    show(result)
    sys.exit(result.exit_code)
