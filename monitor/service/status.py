"""The monitor's health: counters, rates and delays, as one record, the same on the bus and for ``loopsight status``."""

from __future__ import annotations

from typing import Protocol

import msgspec

from monitor.contract.records import WORST_FIRST
from monitor.contract.times import iso
from monitor.engine import Engine
from monitor.wire.decode import Decoder
from monitor.wire.encode import to_json

from .bus import Bus
from .outbox import Outbox
from .reorder import Reorder
from .staleness import NAMED_LOOPS, Staleness
from .trends import Trends

FLAGGED_LOOPS, UNKNOWN_KEYS = 100, 20
"""Named in the status, at most."""


class LoopCounts(msgspec.Struct, frozen=True, kw_only=True):
    """Loops by verdict and by what they do."""

    total: int
    retune: int
    inconclusive: int
    good: int
    not_assessed: int
    open: int
    """With an open event."""
    stale: int


class Rates(msgspec.Struct, frozen=True):
    """What comes in [1/s]."""

    messages: float
    samples: float


class Status(msgspec.Struct, frozen=True, kw_only=True):
    """A monitor's health. Names and order are those of the JSON on the wire."""

    id: str
    time: str
    uptime: float
    """[s]"""
    ready: bool
    """Whether what comes in is heard, and what is found is kept."""
    not_ready: list[str]
    """Why: ``store`` fails, or all loops are ``silent``."""
    loops: LoopCounts
    flagged: list[str]
    messages: int
    dropped: int
    """Messages for which there was no room."""
    samples_ok: int
    uncertain: int
    bad_value: int
    bad_quality: int
    duplicate: int
    conflict: int
    late: int
    malformed: int
    too_large: int
    unknown_loop: int
    future: int
    bad_time: int
    missed_frames: int
    repeated_frames: int
    clock_steps: int
    """Clocks of loops that were set back."""
    clock_ahead: list[str]
    stale: list[str]
    disturbances: int
    unknown: dict[str, int]
    """Keys or names that no loop has, with how often they came."""
    rates: Rates
    queue: int
    """Messages that wait."""
    latency: float
    """Longest wait of a message since the last status was published [s]."""
    held: int
    """Samples that are held for their order."""
    reorder_overflow: int
    """Samples let go before the window's end, for want of room."""
    backlog: int
    """Events that wait to be assessed."""
    waiting_for_store: int
    records_lost: int
    """Because the store failed for too long."""
    publish_failed: int
    """Records that the bus would not take."""


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
    not_ready = [
        why for why, so in (("store", not parts.outbox.stores), ("silent", parts.staleness.silent)) if so
    ]
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
    )


def _loop_counts(parts: Parts) -> LoopCounts:
    watched = parts.engine.loops.by_name.values()
    verdicts = [parts.engine.verdict(k) or WORST_FIRST[-1] for k in watched]
    return LoopCounts(
        total=len(watched),
        **{v: verdicts.count(v) for v in WORST_FIRST},
        open=len(parts.engine.open_rows()),
        stale=len(parts.staleness.stale),
    )


def _names(parts: Parts, rows: set[int], most: int) -> list[str]:
    return [parts.engine.loops[k].name for k in sorted(rows)[:most]]
