"""Rows of a file, and what was counted on the way: bounded, and the same in any cut into tasks."""

from __future__ import annotations

import pickle

import numpy as np
import pytest

from monitor.adapters.historian import rows
from monitor.adapters.historian.rows import Rows, Tally, UnusableError, join_rows


def batch(first: int, n: int) -> Rows:
    at = np.arange(first, first + n)
    one = np.ones(n, np.uint8)
    values = at.astype(float)
    return Rows(at.astype(np.int32), at, values, values, values, one.astype(np.int8), one, one * 0, row=first)


def test_taken_and_joined_again():
    """A joined batch stands where its first part stood."""
    parts = [batch(5, 3), batch(8, 2)]
    whole = join_rows(parts)
    assert (len(whole), whole.row) == (5, 5)
    assert whole.time.tolist() == [5, 6, 7, 8, 9]
    assert whole.take(whole.pv > 6).loop.tolist() == [7, 8, 9]


def test_an_error_travels_between_processes():
    error = pickle.loads(pickle.dumps(UnusableError("a.csv", "no time column", 7)))  # noqa: S301 (our own)
    assert (str(error), error.name, error.line) == ("a.csv:7: no time column", "a.csv", 7)


def test_what_is_remembered_is_bounded(monkeypatch):
    """Counts go on, names and texts stop, and a long text is cut."""
    monkeypatch.setattr(rows, "MOST_TEXTS", 3)
    monkeypatch.setattr(rows, "MOST_NAMES", 3)
    tally = Tally()
    for k in range(10):
        tally.count_text(f"{k}" * 1000, 2)
        tally.count_quality(f"q{k}", 1)
        tally.note_bad_time(f"t{k}")
        tally.note_unknown_loop(f"L{k}" * 1000)
    assert tally.bad_texts == 20
    assert sum(tally.texts.values()) <= 20
    assert max(len(t) for t in tally.texts) <= rows.MOST_TEXT_CHARACTERS
    assert len(tally.texts) <= 4  # the rest is counted together
    assert len(tally.times) == len(tally.unknown) == 3
    assert max(len(n) for n in tally.unknown) == 200


@pytest.mark.parametrize("cut", range(4))
def test_counts_of_tasks_add_up(cut):
    """What two tasks have counted, added: what one would have counted."""

    def count(tally: Tally, k: int) -> None:
        tally.rows += 10 * k
        tally.count_text("Bad", k)
        tally.count_quality("Uncertain", 1)
        tally.note_unknown_loop(f"L{k % 2}")
        tally.loop_rows["A"] = tally.loop_rows.get("A", 0) + k

    whole, first, second = Tally(), Tally(), Tally()
    for k in range(4):
        count(whole, k)
        count(first if k < cut else second, k)
    first.add(second)
    assert first == whole
