"""The long-running service: bus to engine to store to bus, one tick after the other.

The bus's own threads only enqueue; everything else happens in the thread that calls `Service.tick`. What is
published has been committed before.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from pathlib import Path

import msgspec
import numpy as np

from monitor.adapters.store import Store
from monitor.contract import keys
from monitor.contract.danger import TO_RETUNE, danger, worst_first
from monitor.contract.entries import Entries, Message
from monitor.contract.loops import MOST_NAME_BYTES, Loop, LoopTable
from monitor.contract.records import LoopRow, Record
from monitor.contract.samples import Samples
from monitor.contract.status import Status
from monitor.contract.times import iso
from monitor.engine import Engine
from monitor.verdict.stale import mark_stale
from monitor.verdict.together import cycling_together
from monitor.wire.decode import Decoder
from monitor.wire.encode import JSON_MIME, decode_event

from .bus import Bus
from .config import Config
from .every import Every
from .journal import note
from .memories import Memories
from .outbox import Outbox
from .queries import Queries
from .reorder import Reorder
from .shelf import Shelf
from .snapshot import OpenEvents
from .staleness import Staleness
from .status import Meter, encode_status, status_of
from .trends import Trends

TICK_MESSAGES, TICK_BYTES = 50_000, 16 * 2**20
"""Messages, and their bytes, taken from the inbox in one tick: a backlog does not hide all else."""
ASSESS_S, ANSWER_S = 0.05, 0.05
"""Time in a tick for assessing closed events (in an upset the ingest goes on), and for answering queries [s]."""
FINISH_S = 4.0
"""Time for working off and assessing what is held when told to stop; events left over wait for the next start [s]."""
RELEASE_EVERY_S = 0.1
"""Between two looks for loops that have gone idle [s]."""
STALE_EVERY_S = 1.0
"""Between two looks at who has fallen silent [s]."""
STATUS_EVERY_S = 10.0
"""[s]"""
SNAPSHOT_EVERY_S = 10.0
"""Between two writings of what must outlive a kill [s]."""
TIDY_EVERY_S, TIDY_AGAIN_S = 60.0, 1.0
"""Between two looks at what is too old or too much in the store; and while there is more of it [s]."""
MOST_STRETCHES = 2000
"""Loops whose stretches may wait until there is time to see the controllers in them: about 30 MB."""
REGISTERED_LOOPS = 20_000
"""That may register themselves: some 44 kB each, 0.9 GB; whoever has more of them has a loop table."""


class Service:
    """Drives the engine with what the bus brings.

    Parameters
    ----------
    config, loops
        What to watch, and how.
    bus
        Brings messages and queries, and publishes.
    store
        Keeps what is published.
    heard
        Called with every record, after it was published.
    clock
        Wall time [ns since 1970]: for refusing the future, and for the status.
    monotonic
        [s]: for everything that waits.
    open_file
        Where the state of loops with an open event is kept; None: an open event ends with the process.
    """

    def __init__(
        self,
        config: Config,
        loops: LoopTable,
        bus: Bus,
        store: Store,
        heard: Callable[[Record], None] | None = None,
        clock: Callable[[], int] = time.time_ns,
        monotonic: Callable[[], float] = time.monotonic,
        open_file: Path | None = None,
    ) -> None:
        now = monotonic()
        self.config, self.loops, self.bus, self.store = config, loops, bus, store
        self.engine = Engine(loops, MOST_STRETCHES)
        self.reorder = Reorder(len(loops), config.reorder_window)
        self.decoder = Decoder(loops, self._who_registers())
        self.memories = Memories(loops, self.engine, self.reorder, store, now)
        self.outbox = Outbox(loops, bus, store, self.memories, self.row)
        self.staleness = Staleness(loops)
        self.shelf = Shelf(loops, store, clock)
        self.trends = Trends(self.engine, bus, self.shelf)
        self.meter = Meter(now)
        self._heard = heard
        self._full = False
        self._clock, self._monotonic = clock, monotonic
        self._release, self._look = Every(RELEASE_EVERY_S), Every(STALE_EVERY_S)
        self._status = Every(STATUS_EVERY_S)
        self._tidy = Every(TIDY_EVERY_S, first=now + TIDY_EVERY_S)
        self._snapshot = Every(SNAPSHOT_EVERY_S, first=now + SNAPSHOT_EVERY_S)
        self._open = OpenEvents(open_file)
        self._take_up()
        obey = self.shelf.obey if config.commands else None
        self.queries = Queries(config.id, self.engine, store, self.row, self._how, obey)
        self._left_open = self._take_up_events()

    # -- the tick -----------------------------------------------------------------------------------

    def tick(self) -> int:
        """Work off what has come in; return the number of messages."""
        messages = self.bus.inbox.take(TICK_MESSAGES, TICK_BYTES)
        now = self._monotonic()
        if messages:
            self.meter.delayed((self._clock() - messages[0].time) * 1e-9)
        samples, records = self._take_in(messages, now)
        left, self._left_open = self._left_open, []
        self._publish([*left, *records, *self._assess(ASSESS_S)])
        self.trends.take(samples, now)
        self.queries.answer(self.bus.questions, self._in_time(ANSWER_S))
        self._keep_house(now)
        return len(messages)

    def _take_in(self, messages: list[Message], now: float) -> tuple[list[Samples], list[Record]]:
        """Decode, put in order and detect; what nothing newer has followed for the window's length is let go."""
        batches: list[Samples] = []
        records: list[Record] = []
        rest, more = iter(messages), bool(messages)
        while more:
            entries = self.decoder.decode(rest, self._clock() + round(self.config.future * 1e9))
            records += self._take_in_entries(entries, now, batches)
            for cause, key, why in self.decoder.refused:
                note(f"refused_{cause}", key=key, why=why)
            more = self.decoder.settings is not None
            if self.decoder.settings is not None:
                records += self._retuned(*self.decoder.settings)
        if self._release.due(now):  # looks at every loop: not at every tick
            batches.append(self.reorder.release(now - max(self.config.reorder_window, 0.1)))
            records += self.engine.detect(batches[-1])
        return [b for b in batches if len(b)], records

    def _take_in_entries(self, entries: Entries, now: float, batches: list[Samples]) -> list[Record]:
        """Put entries in order and detect; the samples that are due are added to ``batches``."""
        self.engine.follow()
        if len(self.loops) > len(self.reorder.state):
            self.reorder.grow(max(2 * len(self.loops), 64))
        records: list[Record] = []
        samples, at = self.reorder.push(entries, now), 0
        for place, row, first in self.reorder.stepped:
            batches.append(samples.take(slice(at, place)))
            records += [*self.engine.detect(batches[-1]), *self._set_back(row, first)]
            at = place
        batches.append(samples.take(slice(at, None)))
        return records + self.engine.detect(batches[-1])

    def _assess(self, seconds: float) -> list[Record]:
        """Assess closed events for about this long; the rest waits for the next tick."""
        records: list[Record] = []
        in_time = self._in_time(seconds)
        while self.engine.backlog:
            records += self.engine.assess(1)
            if not in_time():
                break
        return records

    def _publish(self, records: list[Record], at_once: bool = False) -> None:
        """Keep and publish records, and tell who listens; what somebody has to see to is flagged."""
        for number, row in self.outbox.add(records):
            self.trends.flag(number, danger(row) <= TO_RETUNE)
        self.outbox.send(self._monotonic(), at_once)
        if self._heard is not None:
            for record in records:
                self._heard(record)

    def _keep_house(self, now: float) -> None:
        """Do what is done every so often."""
        if self._look.due(now):
            last = self.engine.seen.all_last()
            held = self.reorder.state[: len(last.time)]
            self.shelf.look()
            if self.staleness.look(last, held["arrival"], held["newest"], now):
                self._status.hasten(now)
        if self._tidy.due(now):
            for row in self.staleness.overdue(self.reorder.state["arrival"], now):
                self._retire(row)
                note("loop_given_up", loop=self.loops[row].name)
            if self.outbox.tidy(self._clock()):
                self._tidy.postpone(now + TIDY_AGAIN_S)
        if self._snapshot.due(now):
            self._open.keep(self.engine, self.reorder, self._clock())
        if self._status.due(now):
            self.bus.publish(keys.monitor_status(self.config.id), self._how(), JSON_MIME)
            self.meter.published()

    def _in_time(self, seconds: float) -> Callable[[], bool]:
        """Return what says whether these [s] have not passed yet."""
        until = self._monotonic() + seconds
        return lambda: self._monotonic() < until

    # -- loops that change, come and go -------------------------------------------------------------

    def _retuned(self, row: int, loop: Loop) -> list[Record]:
        """Go over to a loop's new settings, ranges and period."""
        records = self.engine.retuned(row, loop)
        self._start_anew(row)
        return records

    def _start_anew(self, row: int) -> None:
        """Let a loop have no flag and no row of an earlier run, and keep what it is from now on."""
        self.memories.hasten(row)
        self.trends.flag(row, False)
        self.queries.forget(self.loops[row].key)

    def _set_back(self, row: int, first: int) -> list[Record]:
        """Begin anew at an earlier time, ``first`` [ns]: what was late since then is a gap."""
        note("clock_set_back", loop=self.loops[row].name, first=iso(first))
        return self.engine.set_back(row, first)

    def _register(self, name: str, key: str) -> int | None:
        """Watch a loop that is in no table."""
        if not 0 < len(name.encode(errors="replace")) <= MOST_NAME_BYTES:
            return None
        if self.staleness.registered >= REGISTERED_LOOPS:
            if not self._full:
                self._full = True
                note("registration_full", count=REGISTERED_LOOPS)
            return None
        if not name.isprintable() or "*" in key or "$" in key:  # for a terminal, or a key of many
            return None
        try:
            row = self.loops.add(Loop(name=name, key=key))
        except ValueError:
            return None
        self.staleness.register(row, self._monotonic())
        return row

    def _retire(self, row: int) -> None:
        """Watch a loop no more; an open event of it ends."""
        self._publish(self.engine.retire(row))
        self.memories.forget(row)
        self.reorder.forget(row)
        self.decoder.forget(row)
        self.loops.remove(row)
        self.staleness.forget(row)
        self.trends.flag(row, False)
        self.queries.forget(self.loops[row].key)

    def _who_registers(self) -> Callable[[str, str], int | None] | None:
        """Return what watches loops that are in no table; None where nobody does."""
        return self._register if self.config.auto_register or not self.config.loops else None

    def reload(self, config: Config, table: LoopTable) -> None:
        """Go over to another configuration and loop table, between two ticks; loops that stay lose nothing."""
        self.config = config
        self.decoder.register = self._who_registers()
        self.reorder.window = round(config.reorder_window * 1e9)
        added = changed = removed = 0
        for row in list(self.loops.by_name.values()):
            old = self.loops[row]
            new = table.by_name.get(old.name)
            if new is None and self.staleness.is_registered(row) and self.decoder.register is not None:
                continue
            if new is None or table[new].key != old.key:
                self._retire(row)
                removed += 1
        records: list[Record] = []
        for loop in table:
            known = self.loops.by_name.get(loop.name)
            if known is None:
                row = self.loops.add(loop)
                self.engine.follow()
                self.engine.take_over(row)
                added += 1
            elif self.engine.declared(known) != loop:
                records += self.engine.redeclared(known, loop)
                self._start_anew(known)
                self.staleness.forget(known)
                changed += 1
        self.reorder.grow(len(self.loops))
        self._publish(records)
        note("reloaded", added=added, changed=changed, removed=removed, loops=len(self.loops.by_name))

    # -- how things stand ---------------------------------------------------------------------------

    def status(self) -> Status:
        """Return the monitor's health, for the bus and for ``loopsight status``."""
        return status_of(self.config.id, self, self._monotonic(), self._clock())

    def _how(self) -> bytes:
        return encode_status(self.status())

    def row(self, number: int) -> LoopRow:
        """Return a loop's row, marked where nothing comes from it any more."""
        last = self.engine.seen.last(number)
        return mark_stale(self.engine.row(number), last, number in self.staleness.stale)

    def rows(self) -> list[LoopRow]:
        """Return all loops' rows, worst first."""
        return sorted(cycling_together([*map(self.row, self.loops.by_name.values())]), key=worst_first)

    # -- begin and end ------------------------------------------------------------------------------

    def _take_up(self) -> None:
        """Go on with what the last run knew of the loops."""
        rows = self.memories.take_up(self._row_of)
        for row in rows:
            if self.engine.verdict(row) is not None:
                self.trends.flag(row, danger(self.engine.row(row)) <= TO_RETUNE)
        if rows:
            note("taken_up", count=len(rows), waiting=len(self.engine.waiting))
        self.outbox.catch_up()

    def _take_up_events(self) -> list[Record]:
        """Go on with the events that were open when the process was killed; return the others, as interrupted."""
        waiting = {one.id for one in self.engine.waiting}
        going_on = self._open.take_up(
            self.engine,
            self.reorder,
            self._row_of,
            lambda identity: identity in waiting or self.store.is_over(identity),
            self._clock(),
            self._monotonic(),
        )
        left: list[Record] = []
        kept = [(key, decode_event(json)) for key, json in self.store.open_events()]
        for key, event in kept:
            if event.id in going_on:
                continue
            over = msgspec.structs.replace(event, state="interrupted")
            if event.loop in self.loops.by_name:
                left.append(over)
            elif event.id:
                self.outbox.let_go(key, over)
        if left:
            note("events_interrupted", count=len(left))
        return left

    def _row_of(self, name: str, key: str) -> int:
        """Return a loop's row, -1 where it is not watched."""
        row = self.loops.by_name.get(name)
        if row is None and self.decoder.register is not None:
            row = self.decoder.register(name, key)
        return -1 if row is None else row

    def run(self, stop: threading.Event, ticked: Callable[[float], None]) -> None:
        """Tick until told to stop; what is held is for `finish`.

        Parameters
        ----------
        ticked
            Called after each tick with how long it took [s].
        """
        while not stop.is_set():
            began = self._monotonic()
            taken = self.tick()
            ticked(self._monotonic() - began)
            if taken == 0:
                stop.wait(self.config.tick)

    def finish(self) -> None:
        """Work off the inbox and the window, close open events, store and publish.

        What comes in meanwhile is left: a publisher that never pauses must not keep us.
        """
        in_time = self._in_time(FINISH_S)
        left = len(self.bus.inbox)
        while left > 0 and in_time() and (taken := self.tick()):
            left -= taken
        last = self.reorder.release(np.inf)
        records = [*self._left_open, *(self.engine.detect(last) if len(last) else [])]
        records += self.engine.close()
        while True:
            self._publish(records, at_once=True)
            if not self.engine.backlog or not in_time():
                break
            records = self._assess(10 * ASSESS_S)
        self.memories.hasten_all()
        self.outbox.send(self._monotonic(), at_once=True)
        self._open.keep(self.engine, self.reorder, self._clock())  # now there is none
        if self.engine.backlog or left > 0:
            note("stopped_early", count=self.engine.backlog, messages=max(left, 0))
        if len(self.outbox):
            note("records_lost", count=len(self.outbox))
