"""The monitor's health: strict JSON under the names of the wire; rates and the longest delay."""

from __future__ import annotations

import json

import msgspec

from monitor.service.status import Meter, encode_status
from tests.monitor.service.tools import a_step, feed, one_loop

NAMES = """
schema id time uptime ready not_ready loops flagged messages dropped
samples_ok uncertain bad_value bad_quality duplicate conflict late
malformed too_large unknown_loop future bad_time missed_frames repeated_frames
clock_steps clock_ahead stale never_heard shelved disturbances unknown rates queue latency held reorder_overflow backlog
waiting_for_store records_lost publish_failed twins
""".split()


def test_status_is_strict_json(bench):
    """Health under its names, in their order, without NaN, whatever the counters hold."""
    b = bench(one_loop())
    feed(b, a_step(50))
    payload = encode_status(b.service.status())
    fields = json.loads(payload, parse_constant=lambda name: name)
    assert list(fields) == NAMES
    assert list(fields["loops"]) == [
        "total",
        "retune",
        "inconclusive",
        "good",
        "not_assessed",
        "open",
        "stale",
        "never_heard",
    ]
    assert list(fields["rates"]) == ["messages", "samples"]
    assert not {"NaN", "Infinity", "-Infinity"} & {v for v in fields.values() if isinstance(v, str)}
    assert fields["loops"]["total"] == 2
    assert fields["messages"] == 50
    assert fields["ready"] is True


def test_it_is_frozen(bench):
    """What was said then stays what was said."""
    status = bench(one_loop()).service.status()
    assert msgspec.structs.replace(status, queue=5).queue == 5
    assert status.__struct_config__.frozen


def test_it_is_published_now_and_every_ten_seconds(bench):
    """At the first tick, then each time ten seconds have passed."""
    b = bench(one_loop())
    for _ in range(30):
        b.tick(1.0)
    assert sum(key == "loopsight/@/monitor/status" for key, _, _ in b.bus.said) == 3


def test_rates_are_those_since_the_last_look():
    """Not within a second of the last one: the same again."""
    meter = Meter(0.0)
    assert (meter.rates(0.5, 100, 100).messages, meter.rates(2.0, 100, 50).messages) == (0.0, 50.0)
    assert meter.rates(2.9, 1000, 1000).samples == 25.0
    assert meter.rates(4.0, 300, 50).messages == 100.0


def test_the_longest_delay_holds_until_it_was_published():
    meter = Meter(0.0)
    for seconds in (0.2, 1.5, 0.1):
        meter.delayed(seconds)
    assert meter.latency == 1.5
    meter.published()
    assert meter.latency == 0.0
