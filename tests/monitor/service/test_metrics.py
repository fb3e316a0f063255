"""Counters and gauges: each that the status has, and none for a single loop."""

from __future__ import annotations

import msgspec
from prometheus_client.parser import text_string_to_metric_families

from monitor.contract.loops import Loop, LoopTable
from monitor.contract.status import Status
from monitor.service.metrics import COUNTERS, GAUGES, Metrics
from tests.monitor.service.tools import a_step, feed, one_loop


def read(text: bytes) -> dict[str, dict[tuple[str, ...], float]]:
    """Values by name and labels."""
    found: dict[str, dict[tuple[str, ...], float]] = {}
    for family in text_string_to_metric_families(text.decode()):
        for sample in family.samples:
            found.setdefault(sample.name, {})[tuple(sample.labels.values())] = sample.value
    return found


def test_every_number_of_the_status_is_a_metric():
    """A counter that is added to the status is added here."""
    numbers = {f.name for f in msgspec.structs.fields(Status) if f.type is int}
    assert numbers == {*COUNTERS, *GAUGES}


def test_what_was_counted_is_told(bench):
    """Under the status' own names."""
    b = bench(one_loop())
    feed(b, [*a_step(50), ("plant/L", b"{"), ("plant/X", b'{"pv": 1}')])
    status = b.service.status()
    found = read(Metrics().text(status, 0.25, 4096))
    assert {n: found[f"loopsight_{n}_total"][()] for n in COUNTERS} == {
        n: getattr(status, n) for n in COUNTERS
    }
    assert found["loopsight_malformed_total"][()] == found["loopsight_unknown_loop_total"][()] == 1
    assert found["loopsight_loops"][("not_assessed",)] == 2
    assert found["loopsight_last_tick_age_seconds"][()] == 0.25
    assert found["loopsight_store_bytes"][()] == 4096


def test_before_the_first_tick():
    """There is the process, and nothing that would be made up."""
    found = read(Metrics().text(None, None, 0))
    assert "loopsight_messages_total" not in found
    assert found["loopsight_tick_seconds_count"][()] == 0


def test_ticks_by_their_duration():
    metrics = Metrics()
    for seconds in (0.002, 0.002, 5.0):
        metrics.ticked(seconds)
    found = read(metrics.text(None, None, 0))
    assert found["loopsight_tick_seconds_bucket"][("0.003",)] == 2
    assert found["loopsight_tick_seconds_bucket"][("3.0",)] == 2
    assert found["loopsight_tick_seconds_bucket"][("10.0",)] == 3


def test_as_much_for_many_loops_as_for_one(bench):
    """No label has a loop's name in it."""
    sizes = [
        Metrics()
        .text(bench(LoopTable([Loop(name=f"L{k}") for k in range(n)])).service.status(), 0.0, 0)
        .count(b"\n")
        for n in (1, 300)
    ]
    assert sizes[0] == sizes[1]
