"""``loopsight demo``."""

from __future__ import annotations

from pathlib import Path

import click

from .common import Command, Refused
from .simulate import scenario_loops


@click.command(cls=Command, epilog="Example: loopsight demo --seconds 60 --view none --out out")
@click.option("--seconds", type=click.FloatRange(min=1), help="End by itself after this time.  [s]")
@click.option("--view", type=click.Choice(["web", "native", "none"]), default="web", show_default=True)
@click.option(
    "--save", type=click.Path(dir_okay=False, path_type=Path), help="Record the view into this .rrd file."
)
@click.option(
    "--out",
    type=click.Path(file_okay=False, path_type=Path),
    help="Write tables and the truth here at the end.",
)
@click.option("--scenario", default="demo", show_default=True, help="Which simulated plant.")
@click.option("--seed", type=int, default=1, show_default=True)
@click.option("--speed", type=click.FloatRange(min=1, max=1000), default=60.0, show_default=True,
              help="Simulated seconds a second.")  # fmt: skip
def demo(
    seconds: float | None,
    view: str,
    save: Path | None,
    out: Path | None,
    scenario: str,
    seed: int,
    speed: float,
) -> None:
    """Watch a simulated plant: loops run, get flagged, and suggestions appear.

    The plant runs in its own process and is heard over Zenoh on loopback, as a real one would be.
    """
    import tempfile

    from monitor.adapters.process import Stop
    from monitor.adapters.tables import write_tables
    from monitor.cli.demo_show import DemoConsole
    from monitor.service.demo import Demo, run_demo
    from sim_plants.export import write_rows
    from sim_plants.truth import TRUTH_COLUMNS, loop_table, truth_rows

    loops = scenario_loops(scenario, seed)
    if out is not None:
        try:
            out.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise Refused(str(error)) from None
    show = DemoConsole()
    with Stop() as stop, tempfile.TemporaryDirectory(prefix="loopsight-") as tables:
        write_rows(Path(tables) / "loops.csv", loop_table(loops))
        arguments = ["--scenario", scenario, "--seed", str(seed), "--speed", str(speed)]
        try:
            assessments, rows = run_demo(Demo(Path(tables), arguments, seconds, view, save), show, stop)
        except (OSError, ChildProcessError) as error:
            raise Refused(str(error)) from None
        show.summary(rows)
        if out is None:
            return
        try:
            write_tables(out, assessments, rows, seconds=False)
            write_rows(out / "truth.csv", truth_rows(loops), TRUTH_COLUMNS)
        except OSError as error:
            raise Refused(str(error)) from None
        click.echo(f"written: {out}/events.parquet, loops.parquet, loops.csv, truth.csv")
