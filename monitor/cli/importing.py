"""``loopsight import``: how an export is understood, and a first loop table."""

from __future__ import annotations

import sys
from pathlib import Path

import click

from .common import Command, Refused

_HELP = """Read any export and say how it is understood.

EXPORT is a CSV, xlsx or Parquet file of any system, a folder or a glob. DIR receives mapping.toml, to be
corrected and given to audit and check by --map, and loops.csv, a loop table with the names. What the data
show (ranges, settings) and what is guessed stands there in columns that begin with #, which are not read: copy what
is right. Exit 2 with one line that says what was not understood and what would help.

\b
Example:
  loopsight import export.xlsx --tz Europe/Berlin --out plant
  loopsight audit export.xlsx --map plant/mapping.toml --loops plant/loops.csv --tz Europe/Berlin --out audit
"""


@click.command("import", cls=Command, help=_HELP)
@click.argument("exports", nargs=-1, required=True, metavar="EXPORT...")
@click.option(
    "--out", required=True, metavar="DIR", type=click.Path(path_type=Path), help="Folder for the results."
)
@click.option("--map", "map_file", metavar="FILE", help="A corrected mapping.toml.")
@click.option("--tz", metavar="ZONE", help="Zone of times that name none, e.g. Europe/Berlin. Default: UTC.")
@click.option(
    "--time-format",
    metavar="FORMAT",
    help="Order of day, month and year in times that are text, e.g. '%d/%m/%Y %H:%M:%S'. Default: told by the data.",
)
@click.option(
    "--time-unit",
    type=click.Choice(["s", "ms", "us", "ns", "excel"]),
    help="Unit of numeric times. Default: told by their range.",
)
def import_exports(
    exports: tuple[str, ...],
    out: Path,
    map_file: str | None,
    tz: str | None,
    time_format: str | None,
    time_unit: str | None,
) -> None:
    """Read, say how, write; exit 0 or 2."""
    from monitor.adapters.historian.mapping import given_mapping
    from monitor.contract.text import visible
    from monitor.importing import run_import

    try:
        found = run_import(exports, out, tz, time_unit, given_mapping(map_file, time_format))
    except (ValueError, OSError) as error:
        raise Refused(str(error)) from None
    for line in found.lines:
        click.echo(visible(line))
    for line in found.problems:
        click.echo(visible(line), err=True)
    if found.files:
        click.echo(visible(f"{out}/: {', '.join(file.name for file in found.files)}"))
    sys.exit(found.exit_code)
