"""Driver of the demo: a simulated plant in its own process, the monitor here, both over real Zenoh on loopback."""

from __future__ import annotations

import subprocess
import tempfile
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from monitor.adapters.loop_table import read_loop_table
from monitor.adapters.process import end, start_own
from monitor.adapters.store import Store
from monitor.adapters.zenoh_bus import DEFAULT_ENDPOINT, Bus, BusError, open_session
from monitor.contract import keys
from monitor.contract.records import RETUNE, Assessment, LoopRow, Record, Suggestion

from .config import Config
from .service import Service, warm_up

COLOURS = {"retune": "bold red", "inconclusive": "yellow", "good": "green", "not_assessed": "dim"}
PROGRESS_EVERY = 5.0
"""[s]"""


@dataclass(frozen=True)
class Demo:
    """What the demo is asked to do."""

    tables: Path
    """Folder with the loop table of the simulated plant."""
    simulate: list[str]
    """Arguments of ``loopsight simulate``, but for the endpoint."""
    seconds: float | None
    view: str
    save: Path | None


def run_demo(demo: Demo, stop: threading.Event) -> tuple[list[Assessment], list[LoopRow]]:
    """Run until the seconds are over or ``stop`` is set; return all assessments and the loops' rows.

    Raises
    ------
    BusError
        No endpoint on loopback is free.
    ChildProcessError
        The simulated plant ended by itself.
    """
    console = Console(highlight=False)
    session, endpoint = _open()
    assessments: list[Assessment] = []
    plant = view = store = None
    with tempfile.TemporaryDirectory(prefix="loopsight-demo-") as state:
        bus = Bus(session)
        try:
            config = Config(id="demo", loops=str(demo.tables / "loops.csv"))
            loops = read_loop_table(config.loops)
            bus.subscribe(config.subscribe, time.time_ns)
            bus.answer([keys.LOOPS, keys.of_monitor(config.id)])
            plant = start_own("simulate", *demo.simulate, "--connect", endpoint)
            with console.status("preparing the fits (the first run compiles them, half a minute)"):
                warm_up()
            view = _start_view(console, demo, endpoint)
            console.print(f"[bold]ready[/]  {len(loops)} loops at {endpoint}   (Ctrl-C ends)")
            store = Store(Path(state))
            service = Service(config, loops, bus, store, heard=_reporter(console, assessments))
            _watch(service, console, plant, demo.seconds, stop)
            end(plant)
            service.finish()
            rows = service.rows()
        finally:
            if plant is not None:
                end(plant)
            if view is not None:
                view.stop()
            bus.close()
            if store is not None:
                store.close()
    console.print(_summary(rows))
    return assessments, rows


def _open() -> tuple[Any, str]:
    """Open the default endpoint, or another one where that is taken."""
    for endpoint in (DEFAULT_ENDPOINT, *(f"tcp/127.0.0.1:{port}" for port in range(7450, 7500))):
        try:
            return open_session("router", listen=[endpoint]), endpoint
        except BusError:
            continue
    raise BusError("tcp/127.0.0.1:7447-7499: no free port for the demo")


def _start_view(console: Console, demo: Demo, endpoint: str) -> Any:
    if demo.view == "none" and demo.save is None:
        return None
    from monitor.view.process import start_view  # noqa: PLC0415 (only where a picture is wanted)

    view = start_view(endpoint, demo.view, demo.save)
    if view.url:
        console.print(f"[bold]view[/]   open {view.url}", soft_wrap=True)
    return view


def _watch(
    service: Service,
    console: Console,
    plant: subprocess.Popen[str],
    seconds: float | None,
    stop: threading.Event,
) -> None:
    """Tick, and say every few seconds how things stand."""
    began = time.monotonic()
    said = 0.0
    while not stop.is_set():
        if service.tick() == 0:
            stop.wait(service.config.tick)
        passed = time.monotonic() - began
        if plant.poll() is not None:
            raise ChildProcessError(f"the simulated plant ended with exit code {plant.returncode}")
        if passed - said >= PROGRESS_EVERY:
            said = passed
            console.print(_progress(service, passed, seconds), soft_wrap=True)
        if seconds is not None and passed >= seconds:
            return


def _progress(service: Service, passed: float, seconds: float | None) -> str:
    status = service.status()
    loops = status["loops"]
    left = "" if seconds is None else f" of {seconds:.0f}"
    return (
        f"[dim]{passed:4.0f}{left} s   {status['samples_ok']:,} samples, {status['rates']['samples']:.0f}/s   "
        f"{loops['total']} loops: {loops['retune']} retune, {loops['good']} good, "
        f"{loops['inconclusive']} inconclusive, {loops['not_assessed']} not assessed, {loops['open']} events open[/]"
    )


def _reporter(console: Console, assessments: list[Assessment]) -> Callable[[Record], None]:
    """Return what keeps the assessments, and prints verdicts that are new and suggestions as they come."""
    verdicts: dict[str, str] = {}

    def heard(record: Record) -> None:
        if isinstance(record, Assessment):
            assessments.append(record)
            if verdicts.get(record.loop) != record.verdict:
                verdicts[record.loop] = record.verdict
                console.print(_verdict(record), soft_wrap=True)
        elif isinstance(record, Suggestion):
            row = record.row
            worst = "" if row.new_ms is None else f"Ms {row.new_ms:.2f}, at worst {row.new_ms_worst:.2f}"
            console.print(
                f"  {escape(row.loop):<9} [bold cyan]suggestion[/]    {row.action}  [dim]({worst})[/]",
                soft_wrap=True,
            )

    return heard


def _verdict(record: Assessment) -> str:
    ci = "" if record.ci is None else f"CI_sp {record.ci:.2f}"
    ms = "" if record.ms is None else f"Ms {record.ms:.2f}"
    return (
        f"  {escape(record.loop):<9} [{COLOURS[record.verdict]}]{record.verdict:<13}[/] {ci:<10}  {ms:<8}  "
        f"[dim]{escape(record.reason)}[/]"
    )


def _summary(rows: list[LoopRow]) -> Table:
    """Return the loops, worst first, as a plant engineer would list them."""
    table = Table(title="Loops, worst first", title_justify="left", box=SIMPLE_HEAD)
    table.add_column("loop", no_wrap=True)
    table.add_column("verdict", no_wrap=True)
    for name in ("CI_sp", "Ms", "T0 [s]"):
        table.add_column(escape(name), justify="right", no_wrap=True)
    table.add_column("what to do", ratio=1)
    for row in rows:
        table.add_row(
            escape(row.loop),
            f"[{COLOURS[row.verdict]}]{row.verdict}[/]",
            *(_figure(value) for value in (row.ci_setpoint, row.ms, row.t0)),
            escape(row.action if row.verdict == RETUNE else row.reason),
        )
    return table


def _figure(value: float | None) -> str:
    return "" if value is None else f"{value:.3g}"
