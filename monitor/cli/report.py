"""``loopsight report``: an audit's report drawn again from its tables."""

from __future__ import annotations

from pathlib import Path

import click

from .common import Command, Refused, since_audit_option

_HELP = """Draw report.html of an audit again, from the tables in its folder DIR.

\b
Example:
  loopsight report audit
  loopsight report audit-april --since-audit audit-march
"""


@click.command("report", cls=Command, help=_HELP)
@click.argument("folder", metavar="DIR")
@since_audit_option
def report(folder: str, since_audit: str | None) -> None:
    """Draw, and say where it is."""
    from monitor.adapters.audit_folder import read_audit
    from monitor.audit.drawing import draw_report

    try:
        last = None if since_audit is None else read_audit(Path(since_audit))
        path = draw_report(Path(folder), last)
    except (ValueError, OSError) as error:
        raise Refused(str(error)) from None
    click.echo(f"{path} ({path.stat().st_size / 1e6:.1f} MB)")
