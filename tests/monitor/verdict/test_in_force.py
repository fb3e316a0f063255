"""The settings in force: the table is believed until the data contradict it; a change is noticed by itself."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from monitor.contract.loops import Loop
from monitor.contract.samples import Samples
from monitor.detect.event import EventWindow
from monitor.verdict.in_force import DATA, TABLE, InForce, change_in_words
from tests.support.controllers import Block, recorded, window_of
from tests.support.plants import stepped
from tests.support.runs import run

RIGHT = Loop(name="L", kp=2.0, ti=80.0)
WRONG = Loop(name="L", kp=2.0, ti=80.0 / 60.0)
START = 1_767_225_600 * 10**9


def window(kp: float = 2.0, ti: float = 80.0) -> EventWindow:
    """Return a set-point step of a loop with these settings."""
    samples = stepped(500, kp=kp, ti=ti, noise=0.02, seed=3)
    time = (samples.time - samples.time[200]) * 1e-9
    return EventWindow(time, samples.sp, samples.pv, samples.op, 200)


def looked(in_force: InForce, *windows: EventWindow, after: int = 0) -> list[bool]:
    """Look at windows, one every hour, ``after`` some hours."""
    starts = [START + (after + k) * 3600 * 10**9 for k in range(len(windows))]
    return [in_force.look(w, t, t + 500 * 10**9, 1.0) for w, t in zip(windows, starts, strict=True)]


def test_a_right_table_is_believed():
    """Its settings are the loop's; nothing is contradicted, nothing has changed."""
    in_force = InForce(RIGHT)
    assert looked(in_force, window(), window()) == [False, False]
    assert (in_force.source, in_force.loop, in_force.contradiction) == (TABLE, RIGHT, "")
    assert in_force.extra_delay == 0.0
    assert in_force.seen is not None
    assert in_force.seen.ti.value == pytest.approx(80.0, rel=0.05)


def test_a_wrong_table_is_contradicted_until_the_data_agree():
    """From the first window on; once the loop runs by the table's settings it is right, and somebody has retuned it."""
    in_force = InForce(RIGHT)
    assert looked(in_force, window(kp=0.5)) == [False]
    assert "table" in in_force.contradiction
    assert in_force.source == TABLE
    assert looked(in_force, window(), after=1) == [True]
    assert in_force.contradiction == ""


def block_window(block: Block, **facts: float) -> EventWindow:
    """Return an event of a loop around a block."""
    return window_of(*recorded(block, noise=0.1, **facts))


@pytest.mark.parametrize(
    ("block", "words"), [(Block(squared=3.0), "square"), (Block(b=0.0, c=0.0), "no kick at a set-point step")]
)
def test_another_law_stays_named_where_quiet_stretches_show_nothing_of_it(block: Block, words: str):
    """Nobody has retuned such a loop, and it is not confirmed by a window in which its table would do as well."""
    in_force = InForce(Block().facts())
    quiet = block_window(Block(), step=0.0, load=3.0)
    assert looked(in_force, block_window(block), quiet, quiet) == [False, False, False]
    assert words in in_force.contradiction
    assert in_force.change is None
    assert in_force.source == TABLE


def test_set_point_weights_are_taken_back_where_the_set_point_shows_them():
    """A step with the kick that the table has."""
    in_force = InForce(Block().facts())
    looked(in_force, block_window(Block(b=0.0, c=0.0)), block_window(Block()))
    assert in_force.contradiction == ""


def test_minutes_for_seconds_are_named():
    """A table in minutes."""
    in_force = InForce(WRONG)
    looked(in_force, window())
    assert "minutes" in in_force.contradiction


def test_without_a_table_the_settings_are_those_seen():
    """In the loop's own form."""
    in_force = InForce(Loop(name="L", form="parallel"))
    assert in_force.source == ""
    assert looked(in_force, window()) == [False]
    assert in_force.source == DATA
    assert in_force.loop.kp == pytest.approx(2.0, rel=0.05)
    assert in_force.loop.ti == pytest.approx(80.0, rel=0.05)
    assert in_force.loop.form == "parallel"


@pytest.mark.parametrize("table", [RIGHT, Loop(name="L")])
def test_a_change_is_noticed_by_itself(table):
    """Two windows under the old settings, then one under new ones: those are in force; it is said when, and which."""
    in_force = InForce(table)
    assert looked(in_force, window(), window(), window(kp=3.5)) == [False, False, True]
    assert in_force.source == DATA
    assert in_force.loop.kp == pytest.approx(3.5, rel=0.05)
    assert in_force.change is not None
    assert in_force.change.before == START + 2 * 3600 * 10**9
    assert "kp 2 to 3.5" in change_in_words(in_force.change)
    assert not in_force.contradiction


def test_back_to_the_table_s_settings():
    """What was retuned and put back is again as the table says."""
    in_force = InForce(RIGHT)
    assert looked(in_force, window(), window(kp=3.5), window()) == [False, True, True]
    assert (in_force.source, in_force.loop) == (TABLE, RIGHT)


def test_an_engine_tells_before_from_after():
    """A loop retuned between two steps, in one export, and the table has the old settings."""
    first, second = stepped(1500, kp=0.6, ti=240.0, noise=0.01), stepped(1500, kp=2.0, ti=80.0, noise=0.01)
    second = replace(second, time=second.time + 1500 * 10**9)
    columns = (np.concatenate([getattr(s, n) for s in (first, second)]) for n in ("time", "sp", "pv", "op"))
    engine, seen = run(Loop(name="L", kp=0.6, ti=240.0), Samples.of(0, *columns))
    row = engine.row(0)
    assert "retuned on" in row.reason
    assert "kp 0.6 to 2" in row.reason
    assert (row.settings_source, row.kp) == ("data", pytest.approx(2.0, rel=0.05))
    assert math.isfinite(row.ti_seen or math.inf)
    assert len(seen.assessments) >= 2


def stretch(kp: float = 2.0, ti: float = 80.0) -> EventWindow:
    """Return a piece of a step's response, as if it were a quiet stretch."""
    whole = window(kp, ti)
    part = slice(190, 318)
    return EventWindow(whole.time[part], whole.sp[part], whole.pv[part], whole.op[part], 128)


def test_a_quiet_stretch_alone_changes_nothing():
    """One that says otherwise has to be followed by another one that says the same; an event's window has not."""
    in_force = InForce(RIGHT)
    seen = looked(in_force, window(), stretch(kp=3.5), stretch(), stretch(kp=3.5))
    assert seen == [False] * 4
    assert (in_force.source, in_force.contradiction) == (TABLE, "")
    assert looked(in_force, stretch(kp=3.5), after=4) == [True]
    assert in_force.loop.kp == pytest.approx(3.5, rel=0.05)
    assert in_force.change is not None
    assert in_force.change.before == START + 3 * 3600 * 10**9  # when it was first seen


def test_a_quiet_stretch_alone_accuses_nobody():
    """Nor does it contradict a table by itself."""
    in_force = InForce(WRONG)
    looked(in_force, stretch())
    assert in_force.contradiction == ""
    looked(in_force, stretch(), after=1)
    assert "minutes" in in_force.contradiction


def test_what_lies_before_the_settings_is_not_looked_at():
    """A window that begins before they came into force shows what its later part alone shows."""
    old, new = window(kp=0.6, ti=240.0), window()
    k = 150
    op = np.r_[old.op[:k] - 3.0, new.op[k:]]
    whole, part = InForce(RIGHT, since=START + k * 10**9), InForce(RIGHT)
    whole.look(EventWindow(new.time, new.sp, new.pv, op, new.before), START, START + 500 * 10**9, 1.0)
    later = (column[k:] for column in (new.time, new.sp, new.pv, op))
    part.look(EventWindow(*later, new.before - k), START + k * 10**9, START + 500 * 10**9, 1.0)
    assert whole.seen is not None
    assert whole.seen == part.seen


def test_a_filter_and_a_scan_that_the_table_names_count():
    """Where the data show nothing of them: a PV filter with its time constant, half of what the scan is longer."""
    flat = EventWindow(np.arange(128.0), np.zeros(128), np.zeros(128), np.zeros(128), 128)
    in_force = InForce(Loop(name="L", pv_filter=5.0, scan=4.0))
    looked(in_force, flat)
    assert in_force.extra_delay == 5.0 + 0.5 * (4.0 - 1.0)
