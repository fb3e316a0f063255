"""The service with a fake bus and clock: stream equals batch, stored before said, asked and answered, never halted."""

from __future__ import annotations

import json
import logging
import math
import sqlite3
from contextlib import closing, contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pyarrow as pa
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from monitor.adapters.store import Store, StoreError
from monitor.contract.loop_fields import parse_row
from monitor.contract.loops import Loop, LoopTable
from monitor.contract.records import Assessment, LoopRow, Suggestion
from monitor.contract.samples import Samples
from monitor.engine import Engine
from monitor.service.config import Config
from monitor.service.service import MOST_UNKEPT, Service, plain
from sim_plants.loops import Simulation
from sim_plants.publish import Publisher
from sim_plants.scenarios import SCENARIOS
from sim_plants.truth import loop_table
from tests.support.bus import FakeBus, Question

START = 1_767_225_600
SENT = START * 10**9
"""When all messages were sent [ns]."""
SECONDS = 1500
LATER = (START + 100_000) * 10**9


class Broken(Store):
    """A store whose disk can fail."""

    failing = False
    commits = 0
    tries = 0

    @contextmanager
    def transaction(self) -> Any:
        self.tries += 1
        if self.failing:
            raise StoreError("disk full")
        with super().transaction():
            yield
        self.commits += 1


class Bench:
    """A service with everything around it."""

    def __init__(self, folder: Path, loops: LoopTable | None = None, **config: Any) -> None:
        self.bus = FakeBus()
        self.store = Broken(folder)
        self.now = 0.0
        self.heard: list[Any] = []
        self.loops = LoopTable([]) if loops is None else loops
        self.service = Service(
            Config(loops="x" if loops is not None else "", **config), self.loops, self.bus, self.store,
            heard=self.heard.append, clock=lambda: LATER, monotonic=lambda: self.now,
        )  # fmt: skip

    def tick(self, seconds: float = 0.0) -> None:
        self.now += seconds
        self.service.tick()

    def ask(self, key: str, parameters: str = "") -> Question:
        question = Question(key, parameters)
        self.bus.questions.append(question)
        self.tick()
        assert question.replies is not None or question.error is not None
        return question

    @property
    def assessments(self) -> list[Assessment]:
        return [r for r in self.heard if isinstance(r, Assessment)]


@pytest.fixture
def bench(tmp_path):
    made = []

    def make(loops: LoopTable | None = None, **config: Any) -> Bench:
        made.append(Bench(tmp_path / str(len(made)), loops, **config))
        return made[-1]

    yield make
    for b in made:
        b.store.close()


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


def messages_of(loops: Any, block: Any, payload: str, rows: int = 13) -> list[tuple[str, bytes]]:
    out: list[tuple[str, bytes]] = []
    publisher = Publisher(lambda key, data: out.append((key, data)), loops, payload)
    step = rows if payload == "frame" else 2000
    for first in range(0, len(block), step):
        publisher.publish(block.rows(slice(first, first + step)))
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
@settings(max_examples=5, suppress_health_check=[HealthCheck.function_scoped_fixture])
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
    status = b.service.status()
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
# the store


def a_step(n: int = 400, at: int = 200) -> list[tuple[str, bytes]]:
    """Samples of a loop L with a step of its set point, quickly settled."""
    sp = (np.arange(n) >= at) * 1.0
    pv = np.convolve(sp, np.full(10, 0.1))[:n]
    rows = zip(sp.tolist(), pv.tolist(), (sp - pv).tolist(), strict=True)
    return [
        ("plant/L", json.dumps({"t": START + k, "sp": s, "pv": p, "op": o}).encode())
        for k, (s, p, o) in enumerate(rows)
    ]


def one_loop() -> LoopTable:
    return LoopTable([Loop(name="L", kp=1.0, ti=10.0), Loop(name="M")])


def feed(b: Bench, messages: Any, seconds: float = 0.0) -> None:
    for key, payload in messages:
        b.bus.put(key, payload, SENT)
    b.tick(seconds)


def test_stored_before_said(bench):
    """When a record is published, another connection already finds it in the file."""
    b = bench(one_loop())
    seen = []

    def look(key: str, payload: bytes) -> None:
        if key.endswith("/assessment"):
            identity = json.loads(payload)["id"]
            with closing(sqlite3.connect(f"file:{b.store.path}?mode=ro", uri=True)) as other:
                seen.extend(
                    other.execute(
                        "SELECT json = ? FROM assessment WHERE id = ?", (payload, identity)
                    ).fetchall()
                )

    b.bus.on_say = look
    feed(b, a_step())
    b.service.finish()
    assert seen == [(1,)]


def test_a_store_that_fails_holds_back_and_loses_nothing(bench, caplog):
    """Assessment goes on, nothing is published, ready is false, one line is logged; then all comes, in order."""
    b = bench(one_loop())
    b.store.failing = True
    with caplog.at_level(logging.INFO, "loopsight"):
        for k, message in enumerate(a_step()):
            b.bus.put(*message, SENT)
            if k % 10 == 0:
                b.tick(0.05)
        assert len(b.assessments) == 1
        assert b.bus.kinds("event") == b.bus.kinds("assessment") == []
        status = b.service.status()
        assert (status["ready"], status["waiting_for_store"] > 0) == (False, True)
        assert b.store.tries <= 4  # once a second, not at every tick
        b.store.failing = False
        b.tick(2.0)
    assert [r["state"] for r in b.bus.kinds("event")] == ["open", "settled"]
    assert len(b.bus.kinds("assessment")) == 1
    assert b.service.status()["ready"]
    assert b.service.status()["waiting_for_store"] == 0
    assert [r.levelname for r in caplog.records if "store" in r.message] == ["ERROR", "WARNING"]


def test_a_store_that_fails_for_ever_is_bounded(bench, monkeypatch):
    """The oldest records are given up and counted; the last try is at the end, and says what is lost."""
    monkeypatch.setattr("monitor.service.service.MOST_UNKEPT", 2)
    assert MOST_UNKEPT > 2
    b = bench(one_loop())
    b.store.failing = True
    feed(b, a_step())
    b.service.finish()
    status = b.service.status()
    assert status["waiting_for_store"] == 2
    assert status["given_up"] >= 2


def test_a_locked_store_neither_stalls_nor_stops(bench):
    """Somebody else's transaction on the file: the tick goes on within a second, and recovers."""
    b = bench(one_loop())
    with closing(sqlite3.connect(b.store.path, isolation_level=None)) as other:
        other.execute("BEGIN IMMEDIATE")
        feed(b, a_step())
        b.tick()
        assert not b.service.ready
        assert b.service.status()["not_ready"] == ["store"]
        other.execute("ROLLBACK")
    b.tick(2.0)
    assert b.service.ready
    assert len(b.bus.kinds("assessment")) == 1


def test_rows_of_an_earlier_run_are_answered(tmp_path):
    """After a restart a loop's row is the last one kept, until it is assessed anew."""
    b = Bench(tmp_path, one_loop())
    feed(b, a_step())
    b.service.finish()
    before = [json.loads(p) for _, p, _ in b.ask("loopsight/plant/L/status").replies]
    b.store.close()
    b = Bench(tmp_path, one_loop())
    after = [json.loads(p) for _, p, _ in b.ask("loopsight/plant/L/status").replies]
    for name in ("verdict", "ci_setpoint", "gain", "t0", "events"):
        assert after[0][name] == before[0][name]
    assert after[0]["verdict"] != "not_assessed"
    b.store.close()


# ---------------------------------------------------------------------------------------------------
# queries


@pytest.fixture
def asked(bench):
    b = bench(
        LoopTable([Loop(name="L", kp=1.0, ti=10.0), Loop(name="M"), Loop(name="W", key="plant/window/W")])
    )
    payload = b'{"schema":1}'
    with b.store.transaction():
        for k in range(5):
            b.store.keep_assessment(f"id{k}", "plant/L", (START + k) * 10**9, payload, b"arrow")
        b.store.keep_assessment("other", "plant/M", START * 10**9, payload, b"arrow")
        b.store.keep_assessment("deep", "plant/window/W", START * 10**9, payload, b"arrow")
    return b


def ids(question: Question) -> list[str]:
    assert question.replies is not None, question.error
    return [key.rpartition("/")[2] for key, _, _ in question.replies]


ISO = "2026-01-01T00:00:0{}Z"


@pytest.mark.parametrize(
    ("parameters", "found"),
    [
        ("", [0, 1, 2, 3, 4]),
        (f"since={START + 1}&until={START + 3}", [1, 2]),
        (f"since={START + 1};until={START + 3}", [1, 2]),
        (f"since={ISO.format(1)}&until={ISO.format(3)}", [1, 2]),
        (f"since={ISO.format(1)[:-1]}%2B".removesuffix("%2B") + "+00:00", [1, 2, 3, 4]),
        (f"since={ISO.format(3)}", [3, 4]),
        (f"until={START + 0.5}", [0]),
        ("limit=2", [3, 4]),
        (f"limit=1&until={START + 2}", [1]),
        ("limit=0", []),
        ("since=-1e300&until=1e300", [0, 1, 2, 3, 4]),
        ("colour=blue", [0, 1, 2, 3, 4]),
    ],
)
def test_history(asked, parameters, found):
    """Since and until half-open, ISO or epoch seconds, `&` or `;`; a limit keeps the newest; one key each."""
    assert ids(asked.ask("loopsight/plant/L/history/*", parameters)) == [f"id{k}" for k in found]


def test_history_by_wildcards_and_id(asked):
    """One event, all loops, a loop whose key holds the word window."""
    assert ids(asked.ask("loopsight/plant/L/history/id3")) == ["id3"]
    assert ids(asked.ask("loopsight/plant/L/history/nothing")) == []
    assert len(ids(asked.ask("loopsight/**/history/*"))) == 7
    assert len(ids(asked.ask("loopsight/plant/*/history/*"))) == 6
    assert ids(asked.ask("loopsight/plant/window/W/history/*")) == ["deep"]
    assert len(ids(asked.ask("**"))) == 7


@pytest.mark.parametrize(
    "parameters",
    [
        "limit=-1",
        "limit=x",
        "limit=",
        "limit=1e3",
        "limit=" + "9" * 30,
        "limit=٣",
        "since=yesterday",
        "until=nan",
        "since=inf",
        "since=",
    ],
)
def test_a_malformed_query_is_refused(asked, parameters):
    """One line that names the parameter; nothing is published, and the tick goes on."""
    question = asked.ask("loopsight/plant/L/history/*", parameters)
    assert question.replies is None
    assert question.error.startswith(parameters.partition("=")[0])
    assert not asked.bus.kinds("history")


def test_window_by_id(asked):
    """The evidence, under its loop's key only."""
    question = asked.ask("loopsight/plant/L/window/id1")
    assert question.replies == [
        ("loopsight/plant/L/window/id1", b"arrow", "application/vnd.apache.arrow.stream")
    ]
    assert ids(asked.ask("loopsight/**/window/id1")) == ["id1"]
    assert ids(asked.ask("loopsight/plant/M/window/id1")) == []
    assert ids(asked.ask("loopsight/plant/L/window/x")) == []


def test_status_of_loops_and_of_the_monitor(asked):
    """One row for each loop that matches; the monitor's own under the verbatim chunk."""
    keys = [k for k, _, _ in asked.ask("loopsight/plant/*/status").replies]
    assert keys == ["loopsight/plant/L/status", "loopsight/plant/M/status"]
    assert [k for k, _, _ in asked.ask("loopsight/plant/window/W/status").replies] == [
        "loopsight/plant/window/W/status"
    ]
    assert len(asked.ask("loopsight/**/status").replies) == 3
    for key in ("loopsight/@/monitor/status", "loopsight/@/*/status"):
        (only,) = asked.ask(key).replies
        assert only[0] == "loopsight/@/monitor/status"
        assert json.loads(only[1])["loops"]["total"] == 3
    assert asked.ask("loopsight/@/other/status").replies == []


KEY = st.lists(
    st.sampled_from(
        ["loopsight", "plant", "L", "*", "**", "@", "monitor", "status", "history", "window", "id1", "x"]
    ),
    min_size=1,
    max_size=6,
)


@given(KEY, st.text(alphabet="since=until&;limt0123456789-+:TZe.\u202e", max_size=40))
@settings(max_examples=200, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_any_query_has_an_answer_or_a_refusal(asked, chunks, parameters):
    """Whatever is asked: replies that match the question, under the prefix, or one line."""
    question = asked.ask("/".join(chunks), parameters)
    assert all(key.startswith("loopsight/") for key, _, _ in question.replies or [])


def test_a_damaged_store_refuses_and_goes_on(asked):
    """A query that the file cannot answer is refused; the loops' status still comes."""
    asked.store._db.execute("DROP TABLE assessment")
    assert "no such table" in asked.ask("loopsight/plant/L/history/*").error
    assert "no such table" in asked.ask("loopsight/plant/L/window/id1").error
    assert len(asked.ask("loopsight/plant/L/status").replies) == 1


def test_many_queries_leave_time_for_samples(bench):
    """Answering stops after its share of the tick; the rest is answered in the next ones."""
    b = bench(one_loop())
    b.service._monotonic = lambda: setattr(b, "now", b.now + 0.02) or b.now
    b.bus.questions.extend(Question("loopsight/**/status") for _ in range(50))
    b.tick()
    assert 0 < len(b.bus.questions) < 50
    for _ in range(50):
        b.tick()
    assert not b.bus.questions


# ---------------------------------------------------------------------------------------------------
# settings, names, registration


def test_settings_start_anew(bench):
    """A re-tuned loop loses its flag and the row of an earlier run, and is judged by its new settings."""
    b = bench(one_loop())
    feed(b, a_step())
    b.service._flagged.add(0)
    b.service._old_rows["plant/L"] = b"old"
    assert b.service.engine.verdict(0) is not None
    feed(b, [("plant/L/settings", b'{"kp": 2.5, "ti": 40}')])
    assert (b.loops[0].kp, b.loops[0].ti, b.loops[0].name) == (2.5, 40.0, "L")
    status = b.service.status()
    assert status["flagged"] == []
    assert b.ask("loopsight/plant/L/status").replies[0][1] != b"old"
    feed(b, [("plant/L/settings", b'{"kp": 0}')])
    assert b.loops[0].kp == 2.5
    assert b.service.status()["malformed"] == 1


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
    status = b.service.status()
    assert status["unknown_loop"] == len(REFUSED)
    b.service.finish()
    assert b.service.status()["samples_ok"] == len(HOSTILE) + 1
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
    assert b.service.status()["unknown_loop"] == 5


def test_registration_is_bounded_and_off_with_a_table(bench, monkeypatch):
    """Up to the most loops; with a table only on request."""
    monkeypatch.setattr("monitor.service.service.MOST_LOOPS", 150)
    b = bench()
    feed(b, [("plant/frame", frame_of([f"n{k}" for k in range(400)]))])
    assert len(b.loops) == 150
    assert len(b.service.order.state) >= 150
    assert b.service.status()["unknown_loop"] == 250
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
@settings(max_examples=100, suppress_health_check=[HealthCheck.function_scoped_fixture])
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
    status = b.service.status()
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
    assert plain("a\x00b\u202e") == "a\ufffdb\ufffd"


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
    assert b.service.status()["samples_ok"] == 400
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
    assert b.service.status()["loops"]["open"] == 40
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
    assert len(b.service.order.state) >= 1000
    b.service.finish()
    assert b.service.status()["samples_ok"] == 1000


def test_idle_loops_are_let_go_by_the_clock(bench):
    """Two seconds after its last sample a loop's held ones are used."""
    b = bench(one_loop())
    feed(b, a_step(5))
    assert b.service.status()["samples_ok"] < 5
    b.tick(1.0)
    assert b.service.order.waiting > 0
    b.tick(1.5)
    assert b.service.status()["samples_ok"] == 5
    assert b.service.order.waiting == 0


def test_stale_loops_are_counted(bench):
    """A loop that sent once and is silent for ten seconds is stale; one that never sent is not."""
    b = bench(one_loop())
    feed(b, a_step(50))
    b.tick(3.0)
    assert b.service.status()["loops"]["stale"] == 0
    b.tick(20.0)
    assert b.service.status()["loops"]["stale"] == 1


def test_status_is_strict_json(bench):
    """Health without NaN, with every cause, whatever the counters hold."""
    b = bench(one_loop())
    status = b.service.status()
    assert json.loads(json.dumps(status, allow_nan=False))["ready"] is True
    assert not [k for k, v in status.items() if isinstance(v, float) and math.isnan(v)]
    assert isinstance(b.service.rows()[0], LoopRow)
