"""The monitor's counters and gauges as Prometheus reads them; no label for a loop, whatever their number."""

from __future__ import annotations

from collections.abc import Iterator

from prometheus_client import CollectorRegistry, Histogram, ProcessCollector, generate_latest
from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, Metric
from prometheus_client.exposition import CONTENT_TYPE_PLAIN_0_0_4 as METRICS_MIME
from prometheus_client.registry import Collector

from monitor.contract.records import WORST_FIRST
from monitor.contract.status import Status

__all__ = ["COUNTERS", "GAUGES", "METRICS_MIME", "Metrics"]

COUNTERS = {
    "messages": "Messages that came in",
    "dropped": "Messages for which there was no room",
    "samples_ok": "Good samples",
    "uncertain": "Samples of uncertain quality, used",
    "bad_value": "Samples without a usable value",
    "bad_quality": "Samples that their source calls bad",
    "duplicate": "Samples that came twice",
    "conflict": "Samples of a time that had another value already",
    "late": "Samples that came too late for their order",
    "malformed": "Payloads that could not be read",
    "too_large": "Payloads beyond the permitted size",
    "unknown_loop": "Samples of loops that are not watched",
    "future": "Samples ahead of this machine's clock",
    "bad_time": "Samples without a usable time",
    "missed_frames": "Frames that never came, by their numbers",
    "repeated_frames": "Frames that came twice, by their numbers",
    "clock_steps": "Clocks of loops that were set back",
    "disturbances": "Upsets that were no clean step",
    "reorder_overflow": "Samples let go before the window's end, for want of room",
    "records_lost": "Records lost because the store failed for too long",
    "publish_failed": "Records that the bus would not take",
}
"""Fields of `Status` that only grow."""
GAUGES = {
    "queue": "Messages that wait",
    "held": "Samples that are held for their order",
    "backlog": "Events that wait to be assessed",
    "twins": "Other monitors under the same id",
    "waiting_for_store": "Records that wait for the store",
}
"""Fields of `Status` that come and go."""
TICK_BUCKETS_S = (0.001, 0.003, 0.01, 0.03, 0.1, 0.3, 1.0, 3.0, 10.0, 30.0)
"""[s]"""


class Metrics:
    """A registry of its own: what other libraries of the process count stays out."""

    def __init__(self) -> None:
        self._registry = CollectorRegistry()
        self._ticks = Histogram(
            "loopsight_tick_seconds", "Duration of a tick", buckets=TICK_BUCKETS_S, registry=self._registry
        )
        ProcessCollector(registry=self._registry)

    def ticked(self, seconds: float) -> None:
        """Count a tick that took so long [s]."""
        self._ticks.observe(seconds)

    def text(self, status: Status | None, age: float | None, store_bytes: int) -> bytes:
        """Return all of it; before the first tick, without a status and an age, what is known by then.

        Parameters
        ----------
        age
            Time since the last completed tick [s].
        store_bytes
            Size of what is kept [bytes].
        """
        found: list[Metric] = []
        if status is not None and age is not None:
            found = [
                GaugeMetricFamily(
                    "loopsight_last_tick_age_seconds", "Time since the last completed tick", age
                ),
                GaugeMetricFamily("loopsight_store_bytes", "Size of what is kept", store_bytes),
                *_families(status),
            ]
        now = CollectorRegistry()
        now.register(_Collected(found))
        return bytes(generate_latest(self._registry) + generate_latest(now))


class _Collected(Collector):
    """What holds at this moment."""

    def __init__(self, families: list[Metric]) -> None:
        self._families = families

    def collect(self) -> Iterator[Metric]:
        return iter(self._families)


def _families(status: Status) -> Iterator[Metric]:
    for name, text in COUNTERS.items():
        yield CounterMetricFamily(f"loopsight_{name}", text, getattr(status, name))
    for name, text in GAUGES.items():
        yield GaugeMetricFamily(f"loopsight_{name}", text, getattr(status, name))
    verdicts = GaugeMetricFamily("loopsight_loops", "Watched loops", labels=["verdict"])
    for verdict in WORST_FIRST:
        verdicts.add_metric([verdict], getattr(status.loops, verdict))
    yield verdicts
    yield GaugeMetricFamily("loopsight_loops_open", "Loops with an open event", status.loops.open)
    yield GaugeMetricFamily(
        "loopsight_loops_stale", "Loops that send nothing, or nothing good", status.loops.stale
    )
    yield GaugeMetricFamily("loopsight_latency_seconds", "Longest wait of a message of late", status.latency)
    yield GaugeMetricFamily("loopsight_uptime_seconds", "Time since the start", status.uptime)
    yield GaugeMetricFamily(
        "loopsight_ready", "1 when what comes in is heard and what is found is kept", status.ready
    )
