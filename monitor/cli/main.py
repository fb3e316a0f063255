"""The command `loopsight`: options, one line for each error, exit codes. What a command does stands in its driver.

Heavy libraries are imported inside the commands, so that `--help` answers at once.
"""

from __future__ import annotations

import importlib
import os
import signal
import sys
import threading
from pathlib import Path
from typing import Any

import click

COMMANDS = {
    "demo": ("monitor.cli.main:demo", "A simulated plant, the monitor and a Rerun view in one go."),
    "monitor": ("monitor.cli.main:monitor", "The long-running service."),
    "audit": ("monitor.audit.result:audit_command", "Fleet audit of historian exports."),
    "tune": ("monitor.cli.tune:tune", "Settings by any tuning rule, with their robustness."),
    "view": ("monitor.view.process:view_command", "Live or recorded visual inspection in Rerun."),
    "status": ("monitor.cli.main:status", "Ask running monitors how they are."),
    "check": ("monitor.check:check_command", "Validate configuration, loop tables and data."),
    "simulate": (
        "monitor.cli.main:simulate",
        "Publish simulated loops, or write them as an export with the truth.",
    ),
}
STOP_WITHIN = 9.0
"""Seconds between being told to stop and a hard end: nothing may keep a service manager waiting."""


class Commands(click.Group):
    """Commands that are imported when they are called."""

    def list_commands(self, ctx: click.Context) -> list[str]:  # noqa: ARG002
        """Return the names, in the order in which a newcomer meets them."""
        return list(COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:  # noqa: ARG002
        """Import a command."""
        if cmd_name not in COMMANDS:
            return None
        module, _, name = COMMANDS[cmd_name][0].partition(":")
        command = getattr(importlib.import_module(module), name)
        assert isinstance(command, click.Command)  # noqa: S101
        if not any(parameter.name == "version" for parameter in command.params):
            command.params.append(version_option())
        return command

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:  # noqa: ARG002
        """List the commands without importing them."""
        with formatter.section("Commands"):
            formatter.write_dl([(name, text) for name, (_, text) in COMMANDS.items()])


class Refused(click.ClickException):
    """An error of the user's: one line, exit 2."""

    exit_code = 2


def _version(ctx: click.Context, _param: click.Parameter, value: bool) -> None:
    if value:
        from importlib.metadata import version

        click.echo(f"loopsight {version('loopsight')}")
        ctx.exit()


def version_option() -> click.Option:
    """Return the option that every command has."""
    return click.Option(
        ["--version"],
        is_flag=True,
        is_eager=True,
        expose_value=False,
        callback=_version,
        help="Show the version.",
    )


@click.group(
    cls=Commands,
    params=[version_option()],
    epilog="Example: loopsight demo",
    context_settings={"help_option_names": ["-h", "--help"]},
)
def loopsight() -> None:
    """Control-loop performance monitor: finds badly tuned PID loops, says why, and suggests safe settings.

    Advice only: it never writes to a controller.
    """


def main() -> None:
    """Run the command line: every error is one line on stderr, never a traceback."""
    try:
        code = loopsight.main(standalone_mode=False, prog_name="loopsight")
    except click.ClickException as error:
        for line in error.format_message().splitlines():
            click.echo(f"loopsight: {line}", err=True)
        code = error.exit_code
    except (click.Abort, KeyboardInterrupt):
        code = 130
    except BrokenPipeError:  # `loopsight ... | head`
        sys.stdout = open(os.devnull, "w")  # noqa: PTH123, SIM115
        code = 0
    except Exception as error:  # the last line of defence
        if os.environ.get("LOOPSIGHT_DEBUG"):
            raise
        click.echo(
            f"loopsight: internal error: {type(error).__name__}: {error} (LOOPSIGHT_DEBUG=1 shows where)",
            err=True,
        )
        code = 1
    sys.exit(code if isinstance(code, int) else 0)


def _until_told() -> threading.Event:
    """Return an event that SIGTERM and SIGINT set; STOP_WITHIN later the process ends, whatever hangs."""
    stop = threading.Event()

    def tell(*_: Any) -> None:
        if not stop.is_set():
            deadline = threading.Timer(STOP_WITHIN, os._exit, (1,))
            deadline.daemon = True
            deadline.start()
        stop.set()

    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, tell)
    return stop


# ---------------------------------------------------------------------------------------------------


@click.command(epilog="Example: loopsight demo --seconds 60 --view none --out out")
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

    from monitor.adapters.tables import write_tables
    from monitor.service.demo import Demo, run_demo
    from sim_plants.export import write_rows
    from sim_plants.truth import TRUTH_COLUMNS, loop_table, truth_rows

    loops = _scenario(scenario, seed)
    if out is not None:
        try:
            out.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise Refused(str(error)) from None
    stop = _until_told()
    with tempfile.TemporaryDirectory(prefix="loopsight-") as tables:
        write_rows(Path(tables) / "loops.csv", loop_table(loops))
        arguments = ["--scenario", scenario, "--seed", str(seed), "--speed", str(speed)]
        try:
            assessments, rows = run_demo(Demo(Path(tables), arguments, seconds, view, save), stop)
        except (OSError, ChildProcessError) as error:
            raise Refused(str(error)) from None
    if out is not None:
        try:
            write_tables(out, assessments, rows, seconds=False)
            write_rows(out / "truth.csv", truth_rows(loops), TRUTH_COLUMNS)
        except OSError as error:
            raise Refused(str(error)) from None
        click.echo(f"written: {out}/events.parquet, loops.parquet, loops.csv, truth.csv")


def _scenario(name: str, seed: int) -> Any:
    from sim_plants.scenarios import SCENARIOS

    if name not in SCENARIOS:
        raise Refused(f"--scenario {name!r}: expected one of {', '.join(SCENARIOS)}")
    return SCENARIOS[name](seed)


@click.command(epilog="Example: loopsight simulate --scenario pumped-tank --hours 4 --out tank")
@click.option("--loops", type=click.IntRange(min=1, max=200_000), help="A random fleet of this many loops.")
@click.option("--scenario", help="A named plant, e.g. demo or pumped-tank.")
@click.option("--plant", type=click.Path(dir_okay=False, path_type=Path), help="A plant file (.toml).")
@click.option("--seed", type=int, default=1, show_default=True)
@click.option("--speed", type=click.FloatRange(min=0.01, max=100_000), default=1.0, show_default=True,
              help="Simulated seconds a second; above 1 it starts in the past.")  # fmt: skip
@click.option("--payload", type=click.Choice(["tag", "sample", "frame"]), default="sample", show_default=True)
@click.option(
    "--connect", default="tcp/127.0.0.1:7447", show_default=True, help="Zenoh endpoint of the monitor."
)
@click.option("--seconds", type=click.FloatRange(min=0.1), help="End by itself after this time.  [s]")
@click.option("--hours", type=click.FloatRange(min=0.001), default=4.0, show_default=True,
              help="With --out: simulated time.  [h]")  # fmt: skip
@click.option("--out", type=click.Path(file_okay=False, path_type=Path),
              help="Write an export here instead: data.parquet, loops.csv, truth.csv, truth_events.csv.")  # fmt: skip
def simulate(
    loops: int | None, scenario: str | None, plant: Path | None, seed: int, speed: float, payload: Any,
    connect: str, seconds: float | None, hours: float, out: Path | None,
) -> None:  # fmt: skip
    """Publish simulated loops on Zenoh, or write them as a historian export with the truth beside it."""
    specs = _loops(loops, scenario, plant, seed)
    if out is not None:
        from sim_plants.export import write_export

        try:
            rows = write_export(specs, hours * 3600.0, out)
        except OSError as error:
            raise Refused(str(error)) from None
        click.echo(f"{rows:,} samples of {len(specs)} loops, {hours:g} h: {out}/data.parquet, loops.csv, truth.csv, "
                   "truth_events.csv")  # fmt: skip
        return
    _publish(specs, connect, speed, payload, seconds)


def _loops(loops: int | None, scenario: str | None, plant: Path | None, seed: int) -> Any:
    if sum(x is not None for x in (loops, scenario, plant)) > 1:
        raise Refused("--loops, --scenario, --plant: expected at most one of them")
    if plant is not None:
        from sim_plants.plantfile import PlantFileError, load_plant_file

        try:
            return load_plant_file(plant)
        except (PlantFileError, OSError) as error:
            raise Refused(str(error)) from None
    if loops is not None:
        from sim_plants.fleet import random_fleet

        return random_fleet(loops, seed)
    return _scenario(scenario or "demo", seed)


def _publish(specs: Any, connect: str, speed: float, payload: Any, seconds: float | None) -> None:
    import time

    from monitor.adapters.zenoh_bus import BusError, open_session, plant_put
    from sim_plants.loops import Simulation
    from sim_plants.publish import Publisher, run, start_time

    stop = _until_told()
    _end_with_parent(stop)
    try:
        session = open_session("client", connect=[connect])
    except BusError as error:
        raise Refused(str(error)) from None
    try:
        simulation = Simulation(specs, start_time(time.time(), speed, seconds))
        run(simulation, Publisher(plant_put(session), specs, payload), speed, seconds, stop)
    finally:
        session.close()


def _end_with_parent(stop: threading.Event) -> None:
    """End when the demo that started us has gone, even by force."""
    parent = int(os.environ.get("LOOPSIGHT_PARENT", "0"))

    def look() -> None:
        while not stop.wait(1.0):
            if os.getppid() != parent:
                stop.set()

    if parent:
        threading.Thread(target=look, daemon=True).start()


# ---------------------------------------------------------------------------------------------------


@click.command(epilog="Example: loopsight monitor --loops loops.csv --connect tcp/10.1.2.3:7447")
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
@click.option("--state", type=click.Path(file_okay=False), help="Folder for what is kept.")
@click.option("--view", type=click.Choice(["web", "native", "none"]), help="Show flagged loops in Rerun.")
@click.option(
    "--save", type=click.Path(dir_okay=False, path_type=Path), help="Record the view into this .rrd file."
)
@click.option("--verbose", is_flag=True, help="Log every assessment.")
def monitor(
    file: Path | None, loops: str | None, connect: tuple[str, ...], listen: tuple[str, ...], state: str | None,
    view: str | None, save: Path | None, verbose: bool,
) -> None:  # fmt: skip
    """Watch loops over Zenoh, day and night.

    Prints a line that begins with `ready` once it listens. SIGTERM or Ctrl-C: finishes what it holds, exit 0.
    """
    from monitor.service.config import load
    from monitor.service.run import run_monitor

    stop = _until_told()
    try:
        config = load(
            file,
            loops=loops,
            connect=list(connect) or None,
            listen=list(listen) or None,
            state=state,
            view=view,
        )
        run_monitor(config, stop, save=save, verbose=verbose)
    except (ValueError, OSError) as error:
        raise Refused(str(error)) from None


@click.command(epilog="Example: loopsight status --json")
@click.option("--connect", default="tcp/127.0.0.1:7447", show_default=True, metavar="ENDPOINT")
@click.option("--json", "as_json", is_flag=True, help="One JSON object for each monitor.")
def status(connect: str, as_json: bool) -> None:
    """Ask running monitors: alive, loops, rates, what was refused and why, flagged loops.

    Exit 0 when at least one answers, 2 when none does.
    """
    from .status import ask_monitors, show

    try:
        answers = ask_monitors(connect)
    except OSError as error:
        raise Refused(str(error)) from None
    if not answers:
        raise Refused(f"{connect}: no monitor answers")
    show(answers, as_json)


if __name__ == "__main__":
    main()
