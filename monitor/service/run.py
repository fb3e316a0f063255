"""Driver of ``loopsight monitor``: opens what the service needs, runs it, closes it in order."""

from __future__ import annotations

import logging
import time
from pathlib import Path
from typing import Any

from monitor.adapters.loop_table import read_loop_table
from monitor.adapters.process import Stop
from monitor.adapters.store import Store
from monitor.adapters.zenoh_bus import DEFAULT_ENDPOINT, Bus, BusError, open_session
from monitor.contract import keys
from monitor.contract.loops import LoopTable

from .config import Config
from .service import Service, warm_up


def run_monitor(config: Config, stop: Stop, save: Path | None = None, verbose: bool = False) -> None:
    """Run the service until ``stop`` is set.

    Raises
    ------
    OSError
        The endpoint, the state folder or a table cannot be used; one line.
    ValueError
        The loop table is wrong; one line for each problem.
    """
    logging.basicConfig(format="%(asctime)s %(levelname)s %(message)s", level=logging.INFO)
    logging.getLogger("loopsight").setLevel(logging.DEBUG if verbose else logging.INFO)
    loops = read_loop_table(config.loops) if config.loops else LoopTable([])
    store = Store(config.state_folder)
    listen = config.listen or ([] if config.connect else [DEFAULT_ENDPOINT])
    try:
        session = open_session("router" if listen else "client", connect=config.connect, listen=listen)
    except BusError:
        store.close()
        raise
    _warn_of_open_doors(listen)
    bus, view = Bus(session), None
    try:
        with stop.breaking_off():  # nothing is held yet: a compiler that has just begun need not end its work
            warm_up()
        if stop.is_set():
            return
        service = Service(config, loops, bus, store, open_file=config.state_folder / "open.npz")
        bus.subscribe(config.subscribe, time.time_ns)
        bus.answer([keys.LOOPS, keys.of_monitor(config.id)])
        bus.alive(keys.monitor_alive(config.id))
        where = ", ".join([*listen, *config.connect])
        print(f"ready {where}: {len(loops) or 'all'} loops on {', '.join(config.subscribe)}", flush=True)  # noqa: T201 (the contract's line)
        view = _view(config, (listen or config.connect)[0], save)
        service.run(stop)
    finally:
        if view is not None:
            view.stop()
        bus.close()
        store.close()


def _view(config: Config, endpoint: str, save: Path | None) -> Any:
    if config.view == "none" and save is None:
        return None
    from monitor.view.process import start_view  # noqa: PLC0415 (only where a picture is wanted)

    view = start_view(endpoint, config.view, save)
    if view.url:
        print(f"view {view.url}", flush=True)  # noqa: T201
    return view


def _warn_of_open_doors(listen: list[str]) -> None:
    """Warn where others than this machine can connect."""
    for endpoint in listen:
        if not any(local in endpoint for local in ("127.0.0.1", "localhost", "[::1]", "unixsock")):
            logging.getLogger("loopsight").warning(
                "%s is open to the network: use TLS and access control, see config/", endpoint
            )
