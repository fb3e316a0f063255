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
from monitor.adapters.process import Hangup, Stop
from monitor.adapters.store import Store
from monitor.adapters.systemd import Manager
from monitor.adapters.zenoh_bus import DEFAULT_ENDPOINT, Bus, BusError, NobodyThereError, open_session
from monitor.contract import keys
from monitor.contract.loops import LoopTable
from monitor.contract.records import Record
from monitor.view.process import start_view

from .config import Config
from .journal import note
from .service import Service
from .staleness import named
from .vitals import Vitals
from .warm_up import warm_up

ROUTER_EVERY_S = 1.0
"""Between two tries to reach a router that does not answer when the monitor starts [s]."""
AT_ONCE = ("loops", "auto_register", "reorder_window", "future", "tick")
"""Settings that are taken over while it runs; the others need another session, store or view."""
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
        unmatched = [loop.name for loop in self.loops if not self.bus.hears(loop.key)]
        if unmatched:
            note("loops_unmatched", count=len(unmatched), loops=named(unmatched))
        self.bus.answer([keys.LOOPS, keys.of_monitor(own)])
        self.bus.alive(keys.monitor_alive(own))
        self.bus.look_for_twins(own, lambda count: note("same_id", monitor=own, count=count))
        return service

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
def opened(
    config: Config, spare: Sequence[str] = (), again: Callable[[str], bool] = lambda _: False
) -> Iterator[Opened]:
    """Open what a monitor needs; all of it is closed at the end, however that comes.

    Parameters
    ----------
    spare
        Endpoints to listen on where the one of the configuration is taken, in turn.
    again
        Asked with the reason, one line, while no router answers: whether to try once more.

    Raises
    ------
    OSError
        The endpoint, the state folder or a table cannot be used; one line.
    ValueError
        The loop table is wrong; one line for each problem.
    """
    loops = _table(config)
    with ExitStack() as closing:
        store = Store(config.state_folder)
        closing.callback(store.close)
        if store.damage:
            note("store_damaged", why=store.damage)
        while True:
            try:
                session, config = _session(config, spare)
                break
            except NobodyThereError as error:
                if not again(str(error)):
                    raise
        bus = Bus(session)
        closing.callback(bus.close)
        endpoint = (_listen(config) or config.connect)[0]
        yield Opened(config, loops, bus, store, endpoint, closing)


def run_monitor(
    read: Callable[[], Config], stop: Stop, say: Callable[[str], None], save: Path | None = None
) -> None:
    """Run the service until ``stop`` is set; SIGHUP has it read its configuration and loop table again.

    A router that does not answer when it starts is waited for.

    Parameters
    ----------
    read
        Reads the configuration; `ConfigError` where it is wrong.
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
    vitals, manager, asked = Vitals(), Manager(), read()

    def again(why: str) -> bool:
        note("router_absent", why=why)
        return not stop.wait(ROUTER_EVERY_S)

    with ExitStack() as closing:
        http = serve(asked, vitals, closing)
        try:
            monitor = closing.enter_context(opened(asked, again=again))
        except NobodyThereError:  # told to stop meanwhile
            return
        hangup = closing.enter_context(Hangup())
        with stop.breaking_off():  # nothing is held yet: a compiler that has just begun need not end its work
            warm_up()
        if stop.is_set():
            return
        service = monitor.start()
        say(f"ready {monitor.where}: {len(monitor.loops) or 'all'} loops on {', '.join(asked.subscribe)}")
        if http:
            say(f"http {http}")
        address = monitor.show(save)
        if address:
            say(f"view {address}")
        manager.ready()

        def ticked(seconds: float) -> None:
            nonlocal asked
            vitals.beat(service, seconds)
            manager.alive()
            if hangup.take():
                asked = read_again(service, read, asked)

        service.run(stop, ticked)
        manager.stopping()
        service.finish()


def serve(config: Config, vitals: Vitals, closing: ExitStack) -> str:
    """Answer over HTTP how the monitor is, where that is configured; return the address, empty where it is not.

    Parameters
    ----------
    closing
        Ends it.

    Raises
    ------
    HttpError
        It cannot listen there.
    """
    if not config.http:
        return ""
    http = Http(config.http, vitals.answers)
    closing.callback(http.close)
    if not is_local(split_address(config.http)[0]):
        note("http_open", address=http.url)
    return http.url


def read_again(service: Service, read: Callable[[], Config], before: Config) -> Config:
    """Read configuration and loop table as a whole and go over to them, or say why the old ones hold.

    Parameters
    ----------
    before
        The configuration as it was read last; returned where it still holds, else the new one.
    """
    try:
        config = read()
        table = _table(config)
    except (ValueError, OSError) as error:
        note("reload_refused", why="; ".join(str(error).splitlines()))
        return before
    later = [
        name
        for name in config.__struct_fields__
        if name not in AT_ONCE and getattr(config, name) != getattr(before, name)
    ]
    if later:
        note("reload_later", names=", ".join(later))
    service.reload(replace(service.config, **{name: getattr(config, name) for name in AT_ONCE}), table)
    return config


def _table(config: Config) -> LoopTable:
    """Read the loop table; without one, none is known."""
    return read_loop_table(config.loops) if config.loops else LoopTable([])


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
            if not spare or isinstance(error, NobodyThereError):
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
