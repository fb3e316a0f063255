"""Asked and answered: history by time, limit and wildcard; evidence; rows of this run and of earlier ones."""

from __future__ import annotations

import json

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from monitor.contract.loops import Loop, LoopTable
from monitor.service.queries import DEFAULT_RECORDS, SLICE_RECORDS
from tests.monitor.assess.test_upset import pulse, upset_loop
from tests.monitor.service.tools import START, Bench, a_step, feed, one_loop
from tests.support.bus import Question


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
    questions = [Question("loopsight/**/status") for _ in range(50)]
    b.bus.questions.extend(questions)
    b.tick()
    assert 0 < sum(bool(q.sent) for q in questions) < 50
    for _ in range(50):
        b.tick()
    assert all(q.replies is not None for q in questions)


def test_who_asks_for_all_is_answered_in_slices(bench):
    """A tick sends some of it; who asks for one thing in between is answered first; a loop that goes is left out."""
    b = bench(LoopTable([Loop(name=f"L{k}") for k in range(3 * SLICE_RECORDS)]))
    times = iter(range(10**9))
    b.service._monotonic = lambda: float(next(times))  # whenever it looks, the time for answers is over
    every, one = Question("loopsight/**/status"), Question("loopsight/@/monitor/status")
    b.bus.questions += [every, one]
    for _ in range(4):
        b.service.tick()
    assert one.replies is not None
    assert every.replies is None
    assert 0 < len(every.sent) < 10
    b.service._retire(b.loops.by_name["L299"])
    ticks = 0
    while every.replies is None:
        b.service.tick()
        ticks += 1
    assert [k for k, _, _ in every.replies] == [f"loopsight/plant/L{k}/status" for k in range(299)]
    assert ticks > 100


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


def test_a_disturbance_is_published_kept_and_counted(bench):
    """An upset that is no clean step: event, assessment and history of its own kind, and one in the status."""
    b = bench(LoopTable([Loop(name="L", kp=2.0, ti=40.0)]))
    s = upset_loop(pulse, 0.05)
    rows = zip(s.sp.tolist(), s.pv.tolist(), s.op.tolist(), strict=True)
    feed(
        b,
        [
            ("plant/L", json.dumps({"t": START + k, "sp": sp, "pv": pv, "op": op}).encode())
            for k, (sp, pv, op) in enumerate(rows)
        ],
    )
    b.tick(5.0)
    b.service.finish()
    (found,) = b.assessments
    assert found.kind == "disturbance"
    kept = [json.loads(payload) for _, payload in b.store.assessments("plant/L")]
    assert [(k["kind"], k["id"], k["ci"]) for k in kept] == [("disturbance", found.id, None)]
    assert kept[0]["recovery"] == pytest.approx(found.recovery)
    assert b.status()["disturbances"] == 1


def test_one_event_however_old(bench):
    """Asked for by its id it is found beyond the records that a question for all brings, and of a loop long gone."""
    b = bench(LoopTable([Loop(name="L")]))
    with b.store.transaction():
        for k in range(DEFAULT_RECORDS + 1):
            b.store.keep_assessment(f"id{k}", "plant/L", (START + k) * 10**9, b"{}", b"arrow")
        b.store.keep_assessment("gone", "plant/GONE", START * 10**9, b"{}", b"arrow")
    assert ids(b.ask("loopsight/**/history/id0")) == ["id0"]
    assert ids(b.ask("loopsight/plant/L/history/id0")) == ["id0"]
    assert ids(b.ask("loopsight/**/history/gone")) == ["gone"]
    assert ids(b.ask("loopsight/plant/M/history/id0")) == []
    assert ids(b.ask("loopsight/**/history/none")) == []
