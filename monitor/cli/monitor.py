"""``loopsight monitor``."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from .common import Command, Refused


@click.command(cls=Command, epilog="Example: loopsight monitor --loops loops.csv --connect tcp/10.1.2.3:7447")
@click.option(
    "--config", "file", type=click.Path(dir_okay=False, path_type=Path), help="Configuration (.toml)."
)
@click.option(
    "--loops", type=click.Path(dir_okay=False), help="Loop table; without one, every loop heard is watched."
)
@click.option("--connect", multiple=True, metavar="ENDPOINT", help="An existing Zenoh router.")
@click.option(
    "--listen",
    multiple=True,
    metavar="ENDPOINT",
    help="Listen here, as a router.  [default: tcp/127.0.0.1:7447]",
)
@click.option(
    "--zenoh",
    type=click.Path(dir_okay=False),
    help="Zenoh's own configuration (.json5): TLS, access control, passwords; see config/zenoh.",
)
@click.option("--state", type=click.Path(file_okay=False), help="Folder for what is kept.")
@click.option("--view", type=click.Choice(["web", "native", "none"]), help="Show flagged loops in Rerun.")
@click.option(
    "--save", type=click.Path(dir_okay=False, path_type=Path), help="Record the view into this .rrd file."
)
@click.option(
    "--http", metavar="ADDRESS", help="Answer /livez, /readyz and /metrics here, e.g. 127.0.0.1:9464."
)
@click.option(
    "--log", type=click.Choice(["text", "json"]), help="Of the log on stderr: for a reader or a machine."
)
@click.option("--verbose", is_flag=True, help="Log every assessment.")
def monitor(file: Path | None, save: Path | None, verbose: bool, **overrides: Any) -> None:
    """Watch loops over Zenoh, day and night.

    Prints a line that begins with `ready` once it listens. SIGTERM or Ctrl-C: finishes what it holds, exit 0.
    SIGHUP: reads configuration and loop table again; where they are wrong the old ones hold.
    """
    from monitor.adapters.process import Stop
    from monitor.service.config import load
    from monitor.service.journal import begin
    from monitor.service.run import run_monitor

    with Stop() as stop:
        try:
            begin(load(file, **overrides).log, verbose)
            run_monitor(lambda: load(file, **overrides), stop, click.echo, save)
        except (ValueError, OSError) as error:
            raise Refused(str(error)) from None
