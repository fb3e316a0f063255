"""How the monitor's health is collected, and its rates and delays."""

from __future__ import annotations

from typing import Protocol

import msgspec

from monitor.contract.records import WORST_FIRST
from monitor.contract.status import NOT_READY, LoopCounts, Rates, Status
from monitor.contract.times import iso
from monitor.engine import Engine
from monitor.wire.decode import Decoder
from monitor.wire.encode import to_json

from .bus import Bus
from .outbox import Outbox
from .reorder import Reorder
from .shelf import Shelf
from .staleness import NAMED_LOOPS, Staleness
from .trends import Trends

FLAGGED_LOOPS, UNKNOWN_KEYS = 100, 20
"""Named in the status, at most."""


def encode_status(status: Status) -> bytes:
    """Return the status as JSON."""
    return to_json(msgspec.to_builtins(status))


class Meter:
    """Rates between two looks, and the longest delay; ``now`` is [s, monotonic]."""

    def __init__(self, now: float) -> None:
        self.started = now
        self.latency = 0.0
        """[s]"""
        self._last = (now, 0, 0)
        self._rates = Rates(0.0, 0.0)

    def delayed(self, seconds: float) -> None:
        """Note how long a message has waited [s]."""
        self.latency = max(self.latency, seconds)

    def published(self) -> None:
        """Begin anew to look for the longest delay."""
        self.latency = 0.0

    def rates(self, now: float, messages: int, samples: int) -> Rates:
        """Return the rates since the last look, at least a second ago, from what there was in all."""
        then, messages_then, samples_then = self._last
        if now - then >= 1.0:
            passed = now - then
            self._rates = Rates((messages - messages_then) / passed, (samples - samples_then) / passed)
            self._last = (now, messages, samples)
        return Rates(round(self._rates.messages, 1), round(self._rates.samples, 1))


class Parts(Protocol):
    """Whose counters these are: the service's."""

    engine: Engine
    reorder: Reorder
    decoder: Decoder
    outbox: Outbox
    staleness: Staleness
    trends: Trends
    shelf: Shelf
    meter: Meter
    bus: Bus


def status_of(monitor: str, parts: Parts, now: float, time: int) -> Status:
    """Collect the status.

    Parameters
    ----------
    monitor
        Its id.
    now, time
        [s, monotonic], [ns since 1970]
    """
    counts = parts.engine.seen.counts()
    samples_ok = counts.pop("ok")
    for name in ("late", "duplicate", "conflict"):
        counts[name] += getattr(parts.reorder, name)
    reasons = (not parts.outbox.stores, not parts.bus.inbox.received, parts.staleness.silent)
    not_ready = [why for why, so in zip(NOT_READY, reasons, strict=True) if so]
    causes = parts.decoder.causes
    return Status(
        id=monitor,
        time=iso(time),
        uptime=round(now - parts.meter.started, 1),
        ready=not not_ready,
        not_ready=not_ready,
        loops=_loop_counts(parts),
        flagged=_names(parts, parts.trends.flagged, FLAGGED_LOOPS),
        messages=parts.bus.inbox.received,
        dropped=parts.bus.inbox.dropped,
        samples_ok=samples_ok,
        **counts,
        malformed=causes["malformed"],
        too_large=causes["too_large"],
        unknown_loop=causes["unknown_loop"],
        future=causes["future"],
        bad_time=causes["bad_time"],
        missed_frames=causes["missed_frames"],
        repeated_frames=causes["repeated_frames"],
        clock_steps=parts.reorder.steps,
        clock_ahead=_names(parts, parts.decoder.ahead, NAMED_LOOPS),
        stale=_names(parts, parts.staleness.stale, NAMED_LOOPS),
        never_heard=_names(parts, parts.staleness.never_heard, NAMED_LOOPS),
        shelved=parts.shelf.said,
        disturbances=parts.engine.disturbances,
        unknown=dict(parts.decoder.unknown.most_common(UNKNOWN_KEYS)),
        rates=parts.meter.rates(now, parts.bus.inbox.received, samples_ok),
        queue=len(parts.bus.inbox),
        latency=round(parts.meter.latency, 3),
        held=parts.reorder.waiting,
        reorder_overflow=parts.reorder.overflow,
        backlog=parts.engine.backlog,
        waiting_for_store=len(parts.outbox),
        records_lost=parts.outbox.records_lost,
        publish_failed=parts.bus.publish_failed,
        twins=parts.bus.twins,
    )


def _loop_counts(parts: Parts) -> LoopCounts:
    watched = parts.engine.loops.by_name.values()
    verdicts = [parts.engine.verdict(k) or WORST_FIRST[-1] for k in watched]
    return LoopCounts(
        total=len(watched),
        **{v: verdicts.count(v) for v in WORST_FIRST},
        open=len(parts.engine.open_rows()),
        stale=len(parts.staleness.stale),
        never_heard=len(parts.staleness.never_heard),
    )


def _names(parts: Parts, rows: set[int], most: int) -> list[str]:
    return [parts.engine.loops[k].name for k in sorted(rows)[:most]]
