"""``loopsight simulate``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from sim_plants.export_layouts import LAYOUTS

from .common import Command, Refused, parent_option, zenoh_option

if TYPE_CHECKING:
    from sim_plants.loops import LoopSpec
    from sim_plants.publish import Payload


def scenario_loops(name: str, seed: int) -> list[LoopSpec]:
    """Return the loops of a named scenario; Refused where there is none of that name."""
    from sim_plants.scenarios import SCENARIOS

    if name not in SCENARIOS:
        raise Refused(f"--scenario {name!r}: expected one of {', '.join(SCENARIOS)}")
    return SCENARIOS[name](seed)


@click.command(cls=Command, epilog="Example: loopsight simulate --scenario pumped-tank --hours 4 --out tank")
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
@click.option("--layout", metavar="NAME", type=click.Choice(sorted(LAYOUTS)),
              help=f"With --out: as a system exports it: {', '.join(sorted(LAYOUTS))}.")  # fmt: skip
@zenoh_option
@parent_option
def simulate(
    loops: int | None, scenario: str | None, plant: Path | None, seed: int, hours: float, out: Path | None,
    layout: str | None, **options: Any,
) -> None:  # fmt: skip
    """Publish simulated loops on Zenoh, or write them as a historian export with the truth beside it."""
    if layout is not None and out is None:
        raise Refused("--layout: expected --out DIR beside it")
    specs = _loops(loops, scenario, plant, seed)
    if out is not None:
        from sim_plants.export import LAYOUT_START, data_name, write_export
        from sim_plants.loops import DEFAULT_START

        how = LAYOUTS.get(layout or "")
        try:
            rows = write_export(specs, hours * 3600.0, out, LAYOUT_START if how else DEFAULT_START, how)
        except (ValueError, OSError) as error:
            raise Refused(str(error)) from None
        files = f"{data_name(how)}, loops.csv, truth.csv, truth_events.csv"
        click.echo(f"{rows:,} samples of {len(specs)} loops, {hours:g} h: {out}/{files}")
        return
    _publish(specs, **options)


def _loops(loops: int | None, scenario: str | None, plant: Path | None, seed: int) -> list[LoopSpec]:
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
    return scenario_loops(scenario or "demo", seed)


def _publish(
    specs: list[LoopSpec],
    connect: str,
    speed: float,
    payload: Payload,
    seconds: float | None,
    parent: int | None,
    zenoh: str,
) -> None:
    import time

    from monitor.adapters.process import Stop
    from monitor.adapters.zenoh_bus import BusError, open_session, plant_put
    from sim_plants.loops import Simulation
    from sim_plants.publish import Publisher, run, start_time

    with Stop(parent=parent) as stop:
        try:
            session = open_session("client", connect=[connect], file=zenoh)
        except BusError as error:
            raise Refused(str(error)) from None
        try:
            simulation = Simulation(specs, start_time(time.time(), speed, seconds))
            run(simulation, Publisher(plant_put(session), specs, payload), speed, seconds, stop)
        finally:
            session.close()
