"""Driver of the demo: a simulated plant in its own process, the monitor here, both over real Zenoh on loopback."""

from __future__ import annotations

import subprocess
import tempfile
import threading
import time
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from monitor.adapters.process import end, start_own
from monitor.adapters.zenoh_bus import DEFAULT_ENDPOINT
from monitor.contract.records import Assessment, LoopRow, Record
from monitor.contract.status import Status

from .config import Config
from .run import opened
from .service import Service
from .warm_up import warm_up

PROGRESS_EVERY_S = 5.0
"""[s]"""
SPARE_PORTS = range(7450, 7500)
"""Where the default one is taken: another monitor may run here."""


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


class Show(Protocol):
    """What is shown of the demo, as it goes on."""

    def preparing(self) -> AbstractContextManager[object]:
        """Say inside that the first run takes a while."""

    def view(self, address: str) -> None:
        """Say where the picture is."""

    def ready(self, loops: int, endpoint: str) -> None:
        """Say that it runs."""

    def heard(self, record: Record) -> None:
        """Show a record, if it is worth it."""

    def progress(self, status: Status, passed: float, seconds: float | None) -> None:
        """Say how things stand after so long, of so long [s]."""


def run_demo(demo: Demo, show: Show, stop: threading.Event) -> tuple[list[Assessment], list[LoopRow]]:
    """Run until the seconds are over or ``stop`` is set; return all assessments and the loops' rows.

    Raises
    ------
    BusError
        No endpoint on loopback is free.
    ChildProcessError
        The simulated plant ended by itself.
    """
    assessments: list[Assessment] = []

    def heard(record: Record) -> None:
        if isinstance(record, Assessment):
            assessments.append(record)
        show.heard(record)

    spare = [f"tcp/127.0.0.1:{port}" for port in SPARE_PORTS]
    with tempfile.TemporaryDirectory(prefix="loopsight-demo-") as state:
        table = str(demo.tables / "loops.csv")
        config = Config(id="demo", loops=table, state=state, listen=[DEFAULT_ENDPOINT], view=demo.view)
        with opened(config, spare) as monitor:
            service = monitor.start(heard)
            plant = start_own("simulate", *demo.simulate, "--connect", monitor.endpoint)
            try:
                with show.preparing():  # what the plant sends meanwhile waits
                    warm_up()
                address = monitor.show(demo.save)
                if address:
                    show.view(address)
                show.ready(len(monitor.loops), monitor.endpoint)
                _watch(service, show, plant, demo.seconds, stop)
            finally:
                end(plant)
            service.finish()
            return assessments, service.rows()


def _watch(
    service: Service, show: Show, plant: subprocess.Popen[str], seconds: float | None, stop: threading.Event
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
        if passed - said >= PROGRESS_EVERY_S:
            said = passed
            show.progress(service.status(), passed, seconds)
        if seconds is not None and passed >= seconds:
            return
