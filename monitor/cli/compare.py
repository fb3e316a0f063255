"""``loopsight compare``: two audits of the same loops, before and after."""

from __future__ import annotations

import click

from .common import Command, Refused

_HELP = """Compare two audits of the same loops: what improved, what got worse, by how much.

OLD and NEW are the folders of the earlier and the later audit. DIR receives compare.html, compare.csv and
compare.parquet (a row per loop, worst first).

\b
Example:
  loopsight compare audit-march audit-april --out change
"""


@click.command("compare", cls=Command, help=_HELP)
@click.argument("old", metavar="OLD")
@click.argument("new", metavar="NEW")
@click.option("--out", required=True, metavar="DIR", help="Folder for the results.")
def compare(old: str, new: str, out: str) -> None:
    """Compare, show what has changed."""
    from monitor.compare.run import run_compare

    from .compare_show import show

    try:
        found, files = run_compare(old, new, out)
    except (ValueError, OSError) as error:
        raise Refused(str(error)) from None
    show(found, files)
