"""``loopsight audit``: a fleet's historian exports in, verdicts and settings out."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import click

from .common import Command, Refused, since_audit_option

_HELP = """Audit a fleet from historian exports.

PATH is a Parquet or CSV file, a folder or a glob: one long table (loop, time, sp, pv, op), a file per loop,
or a wide table (time, LIC-101.SP, LIC-101.PV, LIC-101.OP, ...). DIR receives report.html, loops.csv, loops.xlsx
and loops.parquet (a row per loop, worst first), events.parquet and audit.json.

\b
Example:
  loopsight audit 'export/*.parquet' --loops loops.csv --out audit --jobs 4
"""


@click.command("audit", cls=Command, help=_HELP)
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
@click.option(
    "--time-format",
    metavar="FORMAT",
    help="Order of day, month and year in times that are text, e.g. '%d/%m/%Y %H:%M:%S'. Default: told by the data.",
)
@click.option(
    "--map", metavar="FILE", help="How the exports are to be read, as `loopsight import` writes it."
)
@since_audit_option
@click.option("--resume", is_flag=True, help="Go on with an audit of the same data that was stopped.")
@click.option("--rrd", is_flag=True, help="Write audit.rrd, too: what `loopsight view DIR` shows.")
@click.option("--scheduler", metavar="ADDRESS", help="Run on this Dask cluster, e.g. tcp://10.0.0.5:8786.")
def audit(paths: tuple[str, ...], loops_file: str | None, out: str, rrd: bool, **options: Any) -> None:
    """Audit, show what was found, exit 0 or 2."""
    from monitor.audit.run import run_audit
    from monitor.audit.settings import AuditSettings

    from .audit_show import progress_bar, show

    try:
        with progress_bar() as progress:
            result = run_audit(paths, loops_file, out, AuditSettings(**options), progress=progress)
        if rrd and not result.exit_code:
            result.files.append(_recorded(Path(out)))
    except (ValueError, OSError, ImportError) as error:
        raise Refused(str(error)) from None
    show(result)
    sys.exit(result.exit_code)


def _recorded(out: Path) -> Path:
    """Write the recording of the audit in a folder."""
    from monitor.audit.drawing import contents_of
    from monitor.view.recorded import record_audit

    file = out / "audit.rrd"
    record_audit(contents_of(out), file)
    return file
