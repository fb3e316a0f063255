"""``loopsight report``: an audit's report drawn again from its tables."""

from __future__ import annotations

from pathlib import Path

import click

from .common import Command, Refused

_HELP = """Draw report.html of an audit again, from the tables in its folder DIR.

\b
Example:
  loopsight report audit
"""


@click.command("report", cls=Command, help=_HELP)
@click.argument("folder", metavar="DIR")
def report(folder: str) -> None:
    """Draw, and say where it is."""
    from monitor.audit.drawing import draw_report

    try:
        path = draw_report(Path(folder))
    except (ValueError, OSError) as error:
        raise Refused(str(error)) from None
    click.echo(f"{path} ({path.stat().st_size / 1e6:.1f} MB)")
