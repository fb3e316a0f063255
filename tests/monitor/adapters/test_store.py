"""SQLite: what is committed stays, what fails says so in one line."""

from __future__ import annotations

import os
import signal
import sqlite3
import subprocess
import sys
from contextlib import closing

import pytest

from monitor.adapters.store import VERSION, Store, StoreError


@pytest.fixture
def store(tmp_path):
    s = Store(tmp_path)
    yield s
    s.close()


def keep(store: Store, n: int, key: str = "plant/L") -> None:
    with store.transaction():
        for k in range(n):
            store.keep_assessment(f"id{k}", key, k * 10, b"{%d}" % k, b"w%d" % k)


def test_kept_is_there_after_reopening(tmp_path):
    """Events, assessments with their evidence, suggestions, rows; the same again replaces, but for suggestions."""
    store = Store(tmp_path)
    for _ in range(2):
        with store.transaction():
            store.keep_event("e", "plant/L", 5, b"{}")
            store.keep_suggestion("plant/L", b"{}")
            store.keep_row("plant/L", b"row")
    keep(store, 3)
    keep(store, 3)
    store.close()
    store = Store(tmp_path)
    assert store.counts() == {"event": 1, "assessment": 3, "suggestion": 2}
    assert store.rows() == {"plant/L": b"row"}
    assert store.window("id1") == ("plant/L", b"w1")
    assert store.window("nobody") is None
    store.close()


def test_assessments_by_time_and_limit(store):
    """Half-open, oldest first, the newest where there are more than asked for; of one loop only."""
    keep(store, 5)
    assert [i for i, _ in store.assessments("plant/L")] == [f"id{k}" for k in range(5)]
    assert [i for i, _ in store.assessments("plant/L", since=10, until=30)] == ["id1", "id2"]
    assert [i for i, _ in store.assessments("plant/L", limit=2)] == ["id3", "id4"]
    assert store.assessments("plant/M") == []
    with pytest.raises(StoreError):
        store.assessments("plant/L", since=2**80)


@pytest.mark.parametrize(
    "name", ["../../etc/x", "'; DROP TABLE event; --", "%", "_", "\x00", "ü" * 100, "a\nb"]
)
def test_keys_are_data(store, name):
    """No key does anything but name its own rows."""
    keep(store, 2, name)
    assert len(store.assessments(name)) == 2
    assert store.assessments("plant/L") == []
    assert store.counts()["event"] == 0


def test_all_or_nothing(store):
    """An error inside a transaction, of whatever kind, keeps none of it, and the next one works."""
    for wrong in (
        lambda: store.keep_event("e", "k", 2**80, b""),
        lambda: store.keep_event("e", "k", object(), b""),
    ):
        with pytest.raises((OverflowError, StoreError)), store.transaction():  # noqa: PT012 (both or none)
            store.keep_row("k", b"half")
            wrong()
        assert store.rows() == {}
    with store.transaction():
        store.keep_row("k", b"whole")
    assert store.rows() == {"k": b"whole"}


def test_a_lock_is_an_error_soon_and_goes(store, tmp_path):
    """Another connection's transaction: refused within a second, then fine."""
    with closing(sqlite3.connect(tmp_path / "loopsight.sqlite", isolation_level=None)) as other:
        other.execute("BEGIN IMMEDIATE")
        with pytest.raises(StoreError, match="locked"), store.transaction():
            pass
        other.execute("COMMIT")
    keep(store, 1)


def test_a_read_only_or_full_file_is_an_error_and_recovers(store):
    """Writes fail with the reason, what is kept can be read, and writing works again afterwards."""
    keep(store, 1)
    store._db.execute("PRAGMA query_only=ON")
    with pytest.raises(StoreError, match="readonly"), store.transaction():
        store.keep_row("k", b"x")
    store._db.execute("PRAGMA query_only=OFF")
    pages = store._db.execute("PRAGMA page_count").fetchone()[0]
    store._db.execute(f"PRAGMA max_page_count={pages}")
    with pytest.raises(StoreError, match="full"), store.transaction():
        store.keep_row("k", b"x" * 100_000)
    assert len(store.assessments("plant/L")) == 1
    store._db.execute("PRAGMA max_page_count=1000000")
    with store.transaction():
        store.keep_row("k", b"x" * 100_000)


def test_files_that_are_none(tmp_path):
    """One of a later version, a folder that is a file: one line with the path."""
    Store(tmp_path / "b").close()
    with closing(sqlite3.connect(tmp_path / "b" / "loopsight.sqlite")) as db:
        db.execute(f"PRAGMA user_version={VERSION + 1}")
    with pytest.raises(StoreError) as error:
        Store(tmp_path / "b")
    assert str(error.value).count("loopsight.sqlite") == 1
    assert "a later version" in str(error.value)
    (tmp_path / "c").write_text("")
    with pytest.raises(StoreError, match=r"loopsight\.sqlite"):
        Store(tmp_path / "c")


@pytest.mark.parametrize("how", ["not a database", "a page is damaged"])
def test_a_damaged_file_is_set_aside_and_begun_anew(tmp_path, how):
    """What is left of it stays beside the new one; one line says where."""
    store = Store(tmp_path)
    keep(store, 500)
    store.close()
    damaged = bytearray(store.path.read_bytes())
    damaged[:14] = b"not a database" if how == "not a database" else damaged[:14]
    damaged[8192:20480] = bytes(12288)
    store.path.write_bytes(damaged)
    again = Store(tmp_path)
    assert again.counts()["assessment"] == 0
    keep(again, 3)
    assert again.counts()["assessment"] == 3
    again.close()
    (aside,) = tmp_path.glob("*.damaged-*")
    assert aside.read_bytes() == damaged
    assert aside.name in again.damage
    third = Store(tmp_path)
    assert third.damage == ""
    third.close()
    assert len(list(tmp_path.glob("*.damaged-*"))) == 1


def test_a_file_of_the_first_version_is_brought_up(tmp_path):
    """Its records stay; all of them count as published; what it knew of retunes is gone."""
    store = Store(tmp_path)
    keep(store, 3)
    store._db.executescript(
        "DROP TABLE memory; DROP TABLE waiting; DROP TABLE published;"
        "CREATE TABLE plan (key TEXT PRIMARY KEY, json BLOB NOT NULL); PRAGMA user_version=1;"
    )
    store.close()
    again = Store(tmp_path)
    assert again.counts()["assessment"] == 3
    assert again.unpublished() == []
    assert list(again.memories()) == again.waiting() == []
    again.close()


def test_what_was_not_published_is_said_so(store):
    """After the mark, events first, each with its loop's key; the mark is part of a transaction."""
    keep(store, 2)
    with store.transaction():
        store.keep_event("e", "plant/L", 5, b"{e}")
        store.keep_suggestion("plant/L", b"{s}")
    assert [(u.kind, u.json, u.window) for u in store.unpublished()] == [
        ("event", b"{e}", None),
        ("assessment", b"{0}", b"w0"),
        ("assessment", b"{1}", b"w1"),
        ("suggestion", b"{s}", None),
    ]
    with store.transaction():
        store.keep_published(store.latest())
    assert store.unpublished() == []
    keep(store, 1)
    assert [u.json for u in store.unpublished()] == [b"{0}"]


def test_a_second_monitor_is_kept_out(tmp_path):
    """One store at a time for a folder; one line says so; after the first is closed, or killed, the next may."""
    store = Store(tmp_path)
    with pytest.raises(StoreError, match=r"loopsight\.lock: another monitor uses this folder"):
        Store(tmp_path)
    keep(store, 1)
    store.close()
    Store(tmp_path).close()


DAY = 86_400 * 10**9


def test_what_is_too_old_is_removed_a_little_at_a_time(tmp_path, monkeypatch):
    """By when it was kept, not by its own time; rows of loops stay."""
    remove = Store._remove
    monkeypatch.setattr(Store, "_remove", lambda self, *which: remove(self, *which, most=7))
    store = Store(tmp_path, keep_days=30)
    for day in range(100):
        with store.transaction():
            store.keep_event(f"e{day}", "plant/L", 10, b"")
            store.keep_assessment(f"a{day}", "plant/L", 1000 - day, b"", b"")
            store.keep_suggestion("plant/L", b"")
            store.keep_row("plant/L", b"row")
        if day < 50:
            assert store.tidy(day * DAY) == (day > 30)
    assert store.counts()["assessment"] == 100 - 19
    turns = 0
    while store.tidy(99 * DAY):
        turns += 1
    assert turns > 1
    assert set(store.counts().values()) == {50}  # days on which nobody looked go with the next one
    assert store.assessments("plant/L")[-1][0] == "a50"
    assert store.rows() == {"plant/L": b"row"}
    store.close()


def test_what_is_too_much_is_removed(tmp_path):
    """The oldest go until the size is right, and the file does not grow beyond it."""
    store = Store(tmp_path, keep_bytes=500_000)
    for k in range(400):
        with store.transaction():
            store.keep_event(f"{k}", "plant/L", k, b"x" * 100)
            store.keep_assessment(f"{k}", "plant/L", k, b"x" * 500, b"w" * 5000)
        if k % 50 == 0:
            while store.tidy(DAY):
                pass
    while store.tidy(DAY):
        pass
    assert store.size <= 500_000
    assert store.path.stat().st_size < 1_000_000
    assert store.counts()["assessment"] > 30
    assert store.assessments("plant/L")[-1][0] == "399"
    store.close()


def test_tidying_a_store_that_fails_is_an_error_of_one_line(store):
    """Nothing is removed, and nothing else happens."""
    keep(store, 1)
    store._db.execute("PRAGMA query_only=ON")
    with pytest.raises(StoreError, match="readonly"):
        store.tidy(1000 * DAY)
    assert store.counts()["assessment"] == 1


WRITER = """
import sys
from pathlib import Path
from monitor.adapters.store import Store
store = Store(Path(sys.argv[1]))
n = 0
while True:
    with store.transaction():
        for _ in range(5):
            store.keep_assessment(f"id{n}", "plant/L", n, b"x" * 500, b"w" * 5000)
            n += 1
    print(n, flush=True)
"""


@pytest.mark.parametrize("kills", [3, pytest.param(20, marks=pytest.mark.slow)])
def test_what_was_acknowledged_survives_a_kill(tmp_path, kills):
    """SIGKILL in the middle of commits: every transaction that was acknowledged is whole, and none is half."""
    for k in range(kills):
        folder = tmp_path / str(k)
        writer = subprocess.Popen([sys.executable, "-c", WRITER, str(folder)], stdout=subprocess.PIPE)
        assert writer.stdout is not None
        for _ in range(10 + 7 * k):
            acknowledged = int(writer.stdout.readline())
        os.kill(writer.pid, signal.SIGKILL)
        writer.wait()
        rest = writer.stdout.read().split()
        writer.stdout.close()
        acknowledged = max(acknowledged, *(int(x) for x in rest if x.isdigit()), 0)
        store = Store(folder)
        kept = store.counts()["assessment"]
        assert kept >= acknowledged
        assert kept % 5 == 0
        store.close()


def test_an_event_is_over_once_it_has_closed_or_was_assessed(store):
    """What is open, or not known, is not over: it may be taken up again after a kill."""
    with store.transaction():
        store.keep_event("open", "k", 1, b'{"state":"open"}')
        store.keep_event("closed", "k", 1, b'{"state":"settled"}')
        store.keep_assessment("assessed", "k", 1, b"{}", b"")
    assert [store.is_over(name) for name in ("open", "closed", "assessed", "never")] == [
        False,
        True,
        True,
        False,
    ]
