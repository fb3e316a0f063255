"""Stored before said; where the store fails, nothing is published and nothing is lost, up to a bound."""

from __future__ import annotations

import json
import logging
import sqlite3
from contextlib import closing

from monitor.service.outbox import WAITING_RECORDS
from tests.monitor.service.tools import SENT, a_step, feed, one_loop


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

    b.bus.on_publish = look
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
        status = b.status()
        assert (status["ready"], status["waiting_for_store"] > 0) == (False, True)
        assert b.store.tries <= 4  # once a second, not at every tick
        b.store.failing = False
        b.tick(2.0)
    assert [r["state"] for r in b.bus.kinds("event")] == ["open", "settled"]
    assert len(b.bus.kinds("assessment")) == 1
    assert b.status()["ready"]
    assert b.status()["waiting_for_store"] == 0
    assert [r.levelname for r in caplog.records if "store" in r.message] == ["ERROR", "WARNING"]


def test_a_store_that_fails_for_ever_is_bounded(bench, monkeypatch):
    """The oldest records are given up and counted; the last try is at the end, and says what is lost."""
    monkeypatch.setattr("monitor.service.outbox.WAITING_RECORDS", 2)
    assert WAITING_RECORDS > 2
    b = bench(one_loop())
    b.store.failing = True
    feed(b, a_step())
    b.service.finish()
    status = b.status()
    assert status["waiting_for_store"] == 2
    assert status["records_lost"] >= 2


def test_a_locked_store_neither_stalls_nor_stops(bench):
    """Somebody else's transaction on the file: the tick goes on within a second, and recovers."""
    b = bench(one_loop())
    with closing(sqlite3.connect(b.store.path, isolation_level=None)) as other:
        other.execute("BEGIN IMMEDIATE")
        feed(b, a_step())
        b.tick()
        assert b.status()["not_ready"] == ["store"]
        other.execute("ROLLBACK")
    b.tick(2.0)
    assert b.status()["ready"]
    assert len(b.bus.kinds("assessment")) == 1
