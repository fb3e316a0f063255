"""``loopsight check``: every problem of a configuration, loop table or data file, before it is used."""

from __future__ import annotations

import sys
from pathlib import Path

import click

from .common import Command, Refused

_HELP = """Check configurations, loop tables and data files.

Prints every problem with file, line or row, field, value and what would be accepted. Settings of a loop
table are held against a sample of the data that are given with it, or lie beside it (loops.csv): what OP shows
of the controller, and what contradicts the table, with the likely cause. Exit 0 without problems, 2 with.

\b
Example:
  loopsight check loops.csv monitor.toml export/data.parquet
"""


@click.command("check", cls=Command, help=_HELP)
@click.argument("files", nargs=-1, required=True, metavar="FILE...", type=click.Path(path_type=Path))
@click.option("--tz", metavar="ZONE", help="Zone of times that name none, e.g. Europe/Berlin. Default: UTC.")
@click.option(
    "--time-unit",
    type=click.Choice(["s", "ms", "us", "ns", "excel"]),
    help="Unit of numeric times. Default: told by their range.",
)
@click.option("--time-format", metavar="FORMAT", help="Order of day, month and year in times that are text.")
@click.option(
    "--map",
    "map_file",
    metavar="FILE",
    help="How data files are to be read, as `loopsight import` writes it.",
)
def check(
    files: tuple[Path, ...],
    tz: str | None,
    time_unit: str | None,
    time_format: str | None,
    map_file: str | None,
) -> None:
    """Check, print what was found, exit 0 or 2."""
    from monitor.adapters.historian.mapping import given_mapping
    from monitor.check import check_controllers, check_file, counted
    from monitor.contract.text import visible

    every = []
    for path in files:
        try:
            found = check_file(path, tz, time_unit, given_mapping(map_file, time_format))
        except (ValueError, OSError) as error:
            raise Refused(str(error)) from None
        every.append((path, found))
        for line in found.problems:
            click.echo(visible(line), err=True)
        for line in found.notes:
            click.echo(visible(line))
        if found.what:
            end = f"; {counted(len(found.problems), 'problem')}" if found.problems else "; no problem"
            click.echo(visible(f"{path}: {found.what}{end}"))
    controllers = [found for _, found in check_controllers(every)]
    for found in controllers:
        for line in found.problems:
            click.echo(visible(line), err=True)
        for line in found.notes:
            click.echo(visible(line))
    sys.exit(2 if any(found.problems for found in [*(f for _, f in every), *controllers]) else 0)
