"""The one place where a monitor is put together: store, bus, service, view, opened in order and closed in reverse.

`run_monitor` and the demo both run on it.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from msgspec.structs import replace

from monitor.adapters.http import Http, is_local, split_address
from monitor.adapters.loop_table import read_loop_table
from monitor.adapters.process import Stop
from monitor.adapters.store import Store
from monitor.adapters.systemd import Manager
from monitor.adapters.zenoh_bus import DEFAULT_ENDPOINT, Bus, BusError, open_session
from monitor.contract import keys
from monitor.contract.loops import LoopTable
from monitor.contract.records import Record
from monitor.view.process import start_view

from .config import Config
from .journal import note
from .service import Service
from .vitals import Vitals
from .warm_up import warm_up

LOCAL = ("127.0.0.1", "localhost", "[::1]", "unixsock")
"""In an endpoint that only this machine can reach."""


@dataclass(frozen=True)
class Opened:
    """A monitor whose store and session are open: what can be refused is refused by now. Nothing is heard yet."""

    config: Config
    loops: LoopTable
    bus: Bus
    store: Store
    endpoint: str
    """Where others find it."""
    closing: ExitStack

    @property
    def where(self) -> str:
        """What it listens on and is connected to, for a reader."""
        return ", ".join([*_listen(self.config), *self.config.connect])

    def start(self, heard: Callable[[Record], None] | None = None) -> Service:
        """Hear and answer from now on; the caller ticks.

        Raises
        ------
        OSError
            A key expression is none, or what is kept cannot be read.
        """
        service = Service(
            self.config,
            self.loops,
            self.bus,
            self.store,
            heard,
            open_file=self.config.state_folder / "open.npz",
        )
        own = self.config.id
        self.bus.subscribe(self.config.subscribe, time.time_ns)
        self.bus.answer([keys.LOOPS, keys.of_monitor(own)])
        self.bus.alive(keys.monitor_alive(own))
        self.bus.look_for_twins(own, lambda count: note("same_id", monitor=own, count=count))
        return service

    def serve(self, vitals: Vitals) -> str:
        """Answer over HTTP how the monitor is, where that is configured; return the address, empty where it is not.

        Raises
        ------
        HttpError
            It cannot listen there.
        """
        if not self.config.http:
            return ""
        http = Http(self.config.http, vitals.answers)
        self.closing.callback(http.close)
        if not is_local(split_address(self.config.http)[0]):
            note("http_open", address=http.url)
        return http.url

    def show(self, save: Path | None) -> str:
        """Start the view that is configured, recording into ``save``; return its address, empty where it has none.

        Raises
        ------
        OSError
            The process cannot be started.
        """
        if self.config.view == "none" and save is None:
            return ""
        view = start_view(self.endpoint, self.config.view, save, self.config.zenoh)
        self.closing.callback(view.stop)
        return view.url


@contextmanager
def opened(config: Config, spare: Sequence[str] = ()) -> Iterator[Opened]:
    """Open what a monitor needs; all of it is closed at the end, however that comes.

    Parameters
    ----------
    spare
        Endpoints to listen on where the one of the configuration is taken, in turn.

    Raises
    ------
    OSError
        The endpoint, the state folder or a table cannot be used; one line.
    ValueError
        The loop table is wrong; one line for each problem.
    """
    loops = read_loop_table(config.loops) if config.loops else LoopTable([])
    with ExitStack() as closing:
        store = Store(config.state_folder)
        closing.callback(store.close)
        session, config = _session(config, spare)
        bus = Bus(session)
        closing.callback(bus.close)
        endpoint = (_listen(config) or config.connect)[0]
        yield Opened(config, loops, bus, store, endpoint, closing)


def run_monitor(config: Config, stop: Stop, say: Callable[[str], None], save: Path | None = None) -> None:
    """Run the service until ``stop`` is set.

    Parameters
    ----------
    say
        Called with lines for the user: one that begins with ``ready`` once it listens, then the addresses of HTTP
        and of the view.
    save
        Record the view into this file.

    Raises
    ------
    OSError, ValueError
        As of `opened`.
    """
    vitals, manager = Vitals(), Manager()
    with opened(config) as monitor:
        http = monitor.serve(vitals)
        with stop.breaking_off():  # nothing is held yet: a compiler that has just begun need not end its work
            warm_up()
        if stop.is_set():
            return
        service = monitor.start()
        say(f"ready {monitor.where}: {len(monitor.loops) or 'all'} loops on {', '.join(config.subscribe)}")
        if http:
            say(f"http {http}")
        address = monitor.show(save)
        if address:
            say(f"view {address}")
        manager.ready()

        def ticked(seconds: float) -> None:
            vitals.beat(service, seconds)
            manager.alive()

        service.run(stop, ticked)
        manager.stopping()
        service.finish()


def _listen(config: Config) -> list[str]:
    """Return where a monitor listens: nowhere by default if it has something to connect to."""
    return config.listen or ([] if config.connect else [DEFAULT_ENDPOINT])


def _session(config: Config, spare: Sequence[str]) -> tuple[Any, Config]:
    """Open the session, on a spare endpoint where the first is taken; return it with the configuration that holds."""
    refusal = ""
    for listen in (_listen(config), *([endpoint] for endpoint in spare)):
        try:
            mode = "router" if listen else "client"
            session = open_session(mode, connect=config.connect, listen=listen, file=config.zenoh)
        except BusError as error:
            if not spare:
                raise
            refusal = str(error)
            continue
        foreign = [e for e in listen if not any(local in e for local in LOCAL)]
        if foreign and not config.zenoh:  # which says who may come
            note("network_open", address=", ".join(foreign))
        return session, replace(config, listen=listen)
    raise BusError(
        f"{_listen(config)[0]}, and {len(spare)} more up to {spare[-1]}: no endpoint is free ({refusal})"
    )
