"""The service with a fake bus and clock: stream equals batch, names and settings, never halted, ended in time."""

from __future__ import annotations

import json
import logging
from dataclasses import replace
from typing import Any

import msgspec
import numpy as np
import pyarrow as pa
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from monitor.contract.loop_fields import parse_row
from monitor.contract.loops import Loop, LoopTable
from monitor.contract.records import Assessment, LoopRow, Suggestion
from monitor.contract.samples import Samples
from monitor.engine import Engine
from sim_plants.loops import Simulation
from sim_plants.scenarios import SCENARIOS
from sim_plants.truth import loop_table
from tests.monitor.service.tools import LATER, SENT, START, a_step, feed, messages_of, one_loop

SECONDS = 1500


# ---------------------------------------------------------------------------------------------------
# a plant, and what the engine says of it


def demo_table(loops: Any) -> LoopTable:
    return LoopTable([parse_row(row)[0] for row in loop_table(loops)])


@pytest.fixture(scope="session")
def plant():
    """The demo's loops, their samples for 1500 s, and the records of the engine on the sorted samples."""
    loops = SCENARIOS["demo"](1)
    block = Simulation(loops, START).advance(SECONDS)
    engine = Engine(demo_table(loops))
    samples = Samples.of(block.loop, block.time_ns, block.sp, block.pv, block.op, block.auto)
    records = engine.step(samples) + engine.flush()
    return loops, block, by_loop(r for r in records if isinstance(r, Assessment))


def by_loop(records: Any) -> dict[str, list[Assessment]]:
    out: dict[str, list[Assessment]] = {}
    for r in records:
        out.setdefault(r.loop, []).append(r)
    return out


def disturbed(messages: list[Any], rng: Any, window: int) -> list[Any]:
    """Each message up to a window of messages later."""
    return [
        messages[k]
        for k in np.argsort(np.arange(len(messages)) + rng.integers(0, window, len(messages)), kind="stable")
    ]


def assert_same(found: dict[str, list[Assessment]], expected: dict[str, list[Assessment]]) -> None:
    assert found.keys() == expected.keys()
    for name, records in expected.items():
        assert [msgspec.structs.asdict(r) for r in found[name]] == [
            msgspec.structs.asdict(r) for r in records
        ], name


@pytest.mark.parametrize("payload", ["tag", "sample", "frame"])
@given(seed=st.integers(0, 2**32 - 1), pieces=st.integers(0, 60))
@settings(max_examples=3, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_live_equals_batch(plant, bench, payload, seed, pieces):
    """Tags, samples or frames, in any batches, disturbed within the window: the engine's records, bit by bit."""
    loops, block, expected = plant
    loops = loops[1:4]  # a loop's records rest on its own samples alone
    block = block.rows((block.loop >= 1) & (block.loop < 4))
    block = replace(block, loop=block.loop - 1)
    rng = np.random.default_rng(seed)
    b = bench(demo_table(loops))
    messages = messages_of(loops, block, payload, 3)
    # within 1.9 s: three loops a second, tags in fours, a second in a frame
    messages = disturbed(messages, rng, {"tag": 22, "sample": 5, "frame": 1}[payload])
    if payload == "frame":
        k = int(rng.integers(0, 2))
        messages[k : k + 1400 : 2], messages[k + 1 : k + 1401 : 2] = (
            messages[k + 1 : k + 1401 : 2],
            messages[k : k + 1400 : 2],
        )
    for part in np.split(np.arange(len(messages)), np.sort(rng.integers(0, len(messages), pieces))):
        for k in part:
            b.bus.put(*messages[k], SENT)
        b.tick(0.01)
    b.service.finish()
    status = b.status()
    assert (status["late"], status["samples_ok"]) == (0, len(block))
    assert_same(
        by_loop(b.assessments), {spec.name: expected[spec.name] for spec in loops if spec.name in expected}
    )


def test_what_is_said_is_what_is_kept_and_all_under_the_prefix(plant, bench):
    """Every assessment is published and stored alike; every key lies under the prefix; each record has its schema."""
    loops, block, expected = plant
    b = bench(demo_table(loops))
    for k, message in enumerate(messages_of(loops, block, "frame")):
        b.bus.put(*message, SENT)
        if k % 20 == 0:
            b.tick(1.0)
    b.service.finish()
    said = {r["id"]: r for r in b.bus.kinds("assessment")}
    ids = {r.id for records in expected.values() for r in records}
    assert set(said) == ids
    kept = {i: json.loads(j) for loop in b.loops for i, j in b.store.assessments(loop.key)}
    assert kept == said
    assert all(k.startswith("loopsight/") for k, _, _ in b.bus.said)
    assert {k.rpartition("/")[2] for k, _, _ in b.bus.said} >= {
        "event",
        "assessment",
        "window",
        "suggestion",
        "trend",
        "status",
    }
    assert all(r["schema"] == 1 for kind in ("event", "assessment", "suggestion") for r in b.bus.kinds(kind))
    assert {s.row.loop for s in b.heard if isinstance(s, Suggestion)} == {
        s["loop"] for s in b.bus.kinds("suggestion")
    }
    status = [json.loads(p) for k, p, _ in b.bus.said if k == "loopsight/@/monitor/status"]
    assert len(status) >= 5
    assert status[-1]["time"].endswith("Z")


# ---------------------------------------------------------------------------------------------------
# settings, names, registration


def test_another_table_is_taken_over_while_it_runs(bench, caplog):
    """Loops added, changed, removed: those that stay lose nothing; the row of one that went is another's."""
    b = bench(one_loop())
    feed(b, a_step()[:215])
    (opened,) = b.bus.kinds("event")
    changed = msgspec.structs.replace(b.loops[1], kp=3.0)
    with caplog.at_level(logging.INFO, "loopsight"):
        b.service.reload(b.service.config, LoopTable([b.loops[0], changed]))
    assert "0 loops new, 1 changed, 0 gone; 2 now" in caplog.text
    feed(b, a_step()[215:])
    assert [e["state"] for e in b.bus.kinds("event")] == ["open", "settled"]
    assert b.loops[1].kp == 3.0
    feed(b, a_step()[:215])  # late, all of them
    b.service.reload(b.service.config, LoopTable([changed, Loop(name="N", kp=5.0, op_low=0.0, op_high=9.0)]))
    assert sorted(b.loops.by_name) == ["M", "N"]
    row = b.loops.by_name["N"]
    assert row == 0
    assert b.service.engine.detector.param["op_high"][row] == 9.0
    assert b.service.row(row).events == 0
    feed(b, [(k.replace("/L", "/N"), p) for k, p in a_step()])
    assert [a.loop for a in b.assessments] == ["L", "N"]
    assert opened["id"] == b.assessments[0].id
    status = b.status()
    assert (
        status["samples_ok"] == 800 - 2 * status["held"]
    )  # what was held for the loop that went is gone with it


def test_a_key_that_changes_makes_another_loop_of_it(bench):
    """What was known of the old one is gone with it; an open event ends as interrupted."""
    b = bench(one_loop())
    feed(b, a_step()[:215])
    b.service.reload(
        b.service.config, LoopTable([Loop(name="L", key="plant/x/L", kp=1.0, ti=10.0), b.loops[1]])
    )
    assert [e["state"] for e in b.bus.kinds("event")] == ["open", "interrupted"]
    assert b.loops.by_key.keys() == {"plant/x/L", "plant/M"}


def test_settings_start_anew(bench):
    """A re-tuned loop loses its flag and the row of an earlier run, and is judged by its new settings."""
    b = bench(one_loop())
    feed(b, a_step())
    b.service.trends.flag(0, True)
    b.service.queries._old_rows["plant/L"] = b"old"
    assert b.service.engine.verdict(0) is not None
    feed(b, [("plant/L/settings", b'{"kp": 2.5, "ti": 40}')])
    assert (b.loops[0].kp, b.loops[0].ti, b.loops[0].name) == (2.5, 40.0, "L")
    status = b.status()
    assert status["flagged"] == []
    assert b.ask("loopsight/plant/L/status").replies[0][1] != b"old"
    feed(b, [("plant/L/settings", b'{"kp": 0}')])
    assert b.loops[0].kp == 2.5
    assert b.status()["malformed"] == 1


HOSTILE = [
    "../../etc/x",
    "<script>alert(1)</script>",
    "=cmd()",
    "a/*/b",
    "@x",
    "ü" * 100,
    "x y",
    "plant/x",
    "$(id)",
    "%s%n",
]
REFUSED = ["ü" * 101, "x" * 10_000, "\u202eLIC\u2066", "a\nb", "a\x1b[31m", "\x00", "", "\u200b"]


def frame_of(names: list[str]) -> bytes:
    n = len(names)
    times = pa.array(np.full(n, START * 10**9)).cast(pa.timestamp("ns"))
    ones = pa.array(np.ones(n))
    batch = pa.record_batch(
        [pa.array(names), times, ones, ones, ones], names=["loop", "time", "sp", "pv", "op"]
    )
    sink = pa.BufferOutputStream()
    with pa.ipc.new_stream(sink, batch.schema) as stream:
        stream.write_batch(batch)
    return bytes(sink.getvalue().to_pybytes())


def test_names_register_encoded_or_are_refused(bench):
    """Without a table every loop registers under a key of its own; what a terminal would run is refused and counted."""
    b = bench()
    feed(b, [("plant/frame", frame_of([*HOSTILE, *REFUSED, "fine"]))])
    assert [loop.name for loop in b.loops] == [*HOSTILE, "fine"]
    assert len({loop.key for loop in b.loops}) == len(HOSTILE) + 1
    for loop in b.loops:
        assert loop.key.startswith("plant/")
        assert loop.key.count("/") == 1
        assert not set(loop.key) & set("*$?#")
        assert "/@" not in loop.key
    status = b.status()
    assert status["unknown_loop"] == len(REFUSED)
    b.service.finish()
    assert b.status()["samples_ok"] == len(HOSTILE) + 1
    json.dumps(status, allow_nan=False)


def test_keys_of_many_register_nobody(bench):
    """A put on a wildcard is no loop; keys that decode to the same name are one loop, the others are counted."""
    b = bench()
    feed(
        b,
        [
            (key, b'{"pv":1}')
            for key in ("plant/*", "plant/**", "plant/a$*", "plant/x%2Fy", "plant/x/y", "plant/%1B")
        ],
    )
    assert [(loop.name, loop.key) for loop in b.loops] == [("x/y", "plant/x%2Fy")]
    assert b.status()["unknown_loop"] == 5


def test_registration_is_bounded_and_off_with_a_table(bench, monkeypatch, caplog):
    """Up to the most loops; with a table only on request."""
    monkeypatch.setattr("monitor.service.service.REGISTERED_LOOPS", 150)
    b = bench()
    feed(b, [("plant/frame", frame_of([f"n{k}" for k in range(400)]))])
    assert len(b.loops) == 150
    assert caplog.messages == [
        "150 loops have registered themselves, no more are taken: put them into a loop table"
    ]
    assert len(b.service.reorder.state) >= 150
    assert b.status()["unknown_loop"] == 250
    b = bench(one_loop())
    feed(b, [("plant/new", b'{"pv":1}')])
    assert len(b.loops) == 2
    b = bench(one_loop(), auto_register=True)
    feed(b, [("plant/new", b'{"pv":1}')])
    assert [loop.name for loop in b.loops] == ["L", "M", "new"]


@given(
    st.lists(
        st.tuples(
            st.sampled_from(
                [
                    "plant/L",
                    "plant/L/pv",
                    "plant/L/sp",
                    "plant/L/settings",
                    "plant/frame",
                    "x/*/y",
                    "loopsight/x",
                    "plant/\u202e",
                ]
            ),
            st.binary(max_size=60)
            | st.sampled_from(
                [b"1", b"null", b'{"pv":1,"sp":2,"op":3}', b'{"kp":3}', frame_of(["L", "n", "\n"])]
            ),
        ),
        max_size=30,
    )
)
@settings(max_examples=50, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_no_message_stops_the_service_or_leads_out_of_the_prefix(bench, messages):
    """Anything under any key: ticks go on, and all that is ever put lies under the prefix."""
    b = bench()
    feed(b, messages)
    feed(b, a_step(20))
    b.service.finish()
    b.tick(20.0)
    assert b.bus.said
    assert all(key.startswith("loopsight/") for key, _, _ in b.bus.said)


def test_counters_add_up(bench):
    """What came in is ok or has exactly one cause."""
    b = bench(one_loop())
    step = a_step(60)
    bad = [
        ("plant/L", b"{"), ("plant/nobody", b'{"pv":1}'), ("plant/L", b'{"t":5,"pv":1}'),
        ("plant/L", json.dumps({"t": LATER / 1e9 + 100, "sp": 1, "pv": 1, "op": 1}).encode()),
        ("plant/L", json.dumps({"t": START + 60, "pv": "Bad Input", "sp": 1, "op": 1}).encode()),
        ("plant/L", json.dumps({"t": START + 61, "pv": 1, "sp": 1, "op": 1, "q": 0}).encode()),
        step[59], step[3], ("plant/L", b" " * (17 * 2**20)),
    ]  # fmt: skip
    feed(b, [*step, *bad])
    b.service.finish()
    status = b.status()
    causes = {
        n: status[n]
        for n in (
            "malformed",
            "unknown_loop",
            "bad_time",
            "future",
            "bad_value",
            "bad_quality",
            "duplicate",
            "late",
            "too_large",
        )
    }
    assert causes == dict.fromkeys(causes, 1)
    assert status["samples_ok"] + sum(causes.values()) == status["messages"] == len(step) + len(bad)
    assert "conflict" in status


def test_refusals_are_logged_once_for_each_cause_and_key(bench, caplog):
    """A bad tag at 1 Hz is one line, and its key cannot write to a terminal."""
    b = bench(one_loop())
    with caplog.at_level(logging.WARNING, "loopsight"):
        for _ in range(10):
            feed(b, [("plant/L", b"{"), ("plant/\x1b[31m", b"{")])
    lines = [r.getMessage() for r in caplog.records]
    assert len(lines) == 2
    assert all(line.isprintable() for line in lines)


# ---------------------------------------------------------------------------------------------------
# backlog, stop


def test_a_backlog_is_worked_off_in_pieces_without_loss(bench):
    """More than one tick takes: oldest first, in order."""
    b = bench(one_loop())
    blank = b" " * 100_000
    for key, payload in a_step():
        b.bus.put(key, payload + blank, SENT)
    b.tick()
    assert 0 < len(b.bus.inbox) < 400
    while len(b.bus.inbox):
        b.tick()
    b.service.finish()
    assert b.status()["samples_ok"] == 400
    assert len(b.assessments) == 1


def test_finish_ends_under_a_publisher_that_never_pauses(bench):
    """What was there when told to stop is worked off, stored and said; what keeps coming is left."""
    b = bench(one_loop())
    step = a_step()
    feed(b, step[:100])
    take = b.bus.inbox.take
    more = iter(range(10**6))

    def take_and_refill(*args: Any) -> Any:
        taken = take(*args)
        for _ in range(5):
            b.bus.put(
                "plant/M", json.dumps({"t": START + next(more), "sp": 1, "pv": 1, "op": 1}).encode(), SENT
            )
        return taken

    for message in step[100:260]:
        b.bus.put(*message, SENT)
    b.bus.inbox.take = take_and_refill
    b.service.finish()
    assert [r["state"] for r in b.bus.kinds("event")][-1] in {"settled", "interrupted"}
    assert b.store.counts()["assessment"] == 1


def test_finish_ends_in_an_upset(bench):
    """More open events than can be assessed in time: all are stored as closed, as many as possible assessed."""
    names = [f"N{k}" for k in range(40)]
    b = bench(LoopTable([Loop(name=n, kp=1.0, ti=10.0) for n in names]))
    for _, payload in a_step(210):
        for name in names:
            b.bus.put(f"plant/{name}", payload, SENT)
    b.tick()
    while len(b.bus.inbox):
        b.tick()
    assert b.status()["loops"]["open"] == 40
    clock = iter(range(10**6))
    b.service._monotonic = lambda: next(clock) * 0.5
    b.service.finish()
    counts = b.store.counts()
    assert counts["event"] == 40
    assert 0 < counts["assessment"] < 40
    assert [r["state"] for r in b.bus.kinds("event")].count("interrupted") == 40
    assert len(b.bus.kinds("assessment")) == counts["assessment"]


def test_many_loops_register_in_one_go(bench):
    """A thousand unknown loops in a frame cost one growth, not a thousand."""
    b = bench()
    grown = []
    add = b.service.engine.detector.add
    b.service.engine.detector.add = lambda loops: grown.append(len(loops)) or add(loops)
    feed(b, [("plant/frame", frame_of([f"n{k}" for k in range(1000)]))])
    assert grown == [1000]
    assert len(b.service.reorder.state) >= 1000
    b.service.finish()
    assert b.status()["samples_ok"] == 1000


def test_idle_loops_are_let_go_by_the_clock(bench):
    """Two seconds after its last sample a loop's held ones are used."""
    b = bench(one_loop())
    feed(b, a_step(5))
    assert b.status()["samples_ok"] < 5
    b.tick(1.0)
    assert b.service.reorder.waiting > 0
    b.tick(1.5)
    assert b.status()["samples_ok"] == 5
    assert b.service.reorder.waiting == 0


def test_rows_are_worst_first(bench):
    """What the demo lists at its end."""
    b = bench(one_loop())
    feed(b, a_step())
    rows = b.service.rows()
    assert all(isinstance(row, LoopRow) for row in rows)
    assert [row.loop for row in rows] == ["L", "M"]
