"""Reorder: late arrivals sorted in, tags put together, against a naive twin in plain Python."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from monitor.contract.entries import ENTRY, MODE_UNKNOWN, SAMPLE, TAG_AUTO, TAG_OP, TAG_PV, TAG_SP
from monitor.contract.samples import QUALITY_UNCERTAIN, Samples
from monitor.service.reorder import HELD_ENTRIES, Reorder
from tests.support.samples import join

SECOND = 10**9
T0 = 1_795_341_600 * SECOND
NAN = math.nan


def entry(t, kind=SAMPLE, loop=0, sp=1.0, pv=2.0, op=3.0, auto=1, quality=192):
    """An arrival at T0 + t [s]; of a tag only its own quantity stays."""
    if kind != SAMPLE:
        sp, pv, op = (v if kind == k else NAN for v, k in ((sp, TAG_SP), (pv, TAG_PV), (op, TAG_OP)))
    return (T0 + round(t * SECOND), loop, kind, auto, quality, sp, pv, op)


def entries(*rows):
    return np.array(list(rows), ENTRY)


def rows_of(samples: Samples) -> list[tuple]:
    """Samples as rows that compare equal where both are NaN."""
    columns = (samples.loop, samples.time, samples.sp, samples.pv, samples.op, samples.auto, samples.quality)
    return [
        tuple(None if math.isnan(v) else v for v in row)
        for row in zip(*(c.tolist() for c in columns), strict=True)
    ]


def through(order: Reorder, batches, arrival=0.0) -> list[tuple]:
    """All samples that come out, the held ones at the end."""
    out = [order.push(batch, arrival) for batch in batches]
    return rows_of(join([*out, order.release(math.inf)]))


def times(rows):
    return [(r[1] - T0) / SECOND for r in rows]


# ---------------------------------------------------------------------------------------------------
# the naive twin


@dataclass
class Twin:
    """Sort, then walk: what any order of arrival within the window must give."""

    last: dict = field(default_factory=dict)
    duplicate: int = 0
    conflict: int = 0

    def run(self, arrivals) -> list[tuple]:
        out = []
        for x in sorted(arrivals, key=lambda x: (x["loop"], x["time"], x["kind"])):
            hold = self.last.setdefault(
                int(x["loop"]), {TAG_SP: (None, NAN), TAG_OP: (None, NAN), TAG_AUTO: (None, 1)}
            )
            kind, time = int(x["kind"]), int(x["time"])
            values = float(x["sp"]), float(x["pv"]), float(x["op"]), bool(x["auto"])
            if kind in hold:
                value = {TAG_SP: values[0], TAG_OP: values[2], TAG_AUTO: int(x["auto"])}[kind]
                good = x["quality"] >= QUALITY_UNCERTAIN and (
                    value != MODE_UNKNOWN if kind == TAG_AUTO else math.isfinite(value)
                )
                if good and (hold[kind][0] is None or time > hold[kind][0]):
                    hold[kind] = (time, value)
                continue
            if kind == TAG_PV:
                values = hold[TAG_SP][1], values[1], hold[TAG_OP][1], bool(hold[TAG_AUTO][1])
            row = (int(x["loop"]), time, *(None if math.isnan(v) else v for v in values), int(x["quality"]))
            if out and out[-1][:2] == row[:2]:
                self.duplicate += 1
                self.conflict += out[-1][2:5] != row[2:5]
            else:
                out.append(row)
        return out


def by_loop(rows):
    return sorted(rows, key=lambda r: r[0])


@st.composite
def arrivals_within(draw, window=2.0, most=50):
    """Entries of some loops, arriving in any order in which none is later than the window."""
    n = draw(st.integers(1, most))
    rows = []
    for k in range(n):
        kind = draw(st.sampled_from([SAMPLE, SAMPLE, TAG_SP, TAG_OP, TAG_AUTO, TAG_PV]))
        t = draw(st.integers(0, 40)) * 0.25
        quality = draw(st.sampled_from([192, 192, 192, 216, 64, 0]))
        auto = draw(st.sampled_from([0, 1, MODE_UNKNOWN])) if kind == TAG_AUTO else 1
        value = draw(st.sampled_from([float(k), float(k), float(k), NAN]))
        rows.append((t, draw(st.integers(0, 2)), kind, auto, quality, value, draw(st.floats(0, window))))
    # each is delayed by at most the window: nothing arrives after what is newer by more than that
    rows.sort(key=lambda r: r[0] + r[6])
    out = [
        entry(t, kind, loop, sp=v, pv=v + 0.5, op=v + 0.25, auto=a, quality=q)
        for t, loop, kind, a, q, v, _ in rows
    ]
    cuts = sorted(draw(st.lists(st.integers(0, n), max_size=4)))
    return np.array(out, ENTRY), cuts


@given(arrivals_within())
@settings(max_examples=150)
def test_any_order_within_the_window_is_the_sorted_one(drawn):
    """However the arrivals are disturbed within the window and batched, out comes what sorting them gives."""
    arrived, cuts = drawn
    order = Reorder(3)
    got = by_loop(through(order, np.split(arrived, cuts)))
    twin = Twin()
    assert got == by_loop(twin.run(arrived))
    assert (order.duplicate, order.conflict) == (twin.duplicate, twin.conflict)
    assert order.late == 0
    assert order.waiting == 0


@given(arrivals_within(), st.integers(0, 2**32 - 1))
@settings(max_examples=100)
def test_every_sample_comes_out_or_is_counted(drawn, seed):
    """Of arrivals in any order at all, good ones come out in order, and each is out, late or a repeat."""
    arrived, cuts = drawn
    arrived = arrived[(arrived["kind"] == SAMPLE) | (arrived["kind"] == TAG_PV)]
    arrived = np.random.default_rng(seed).permutation(arrived)
    order = Reorder(3, window=0.5)
    got = through(order, np.split(arrived, cuts))
    assert len(got) + order.late + order.duplicate == len(arrived)
    for loop in range(3):
        good = [r[1] for r in got if r[0] == loop and r[6] >= QUALITY_UNCERTAIN and None not in r[3:5]]
        assert good == sorted(good)


# ---------------------------------------------------------------------------------------------------


def test_what_is_later_than_the_window_is_counted_and_dropped():
    """The window closes 2 s behind the newest: its edge is in, beyond it is late."""
    order = Reorder(1)
    got = through(order, [entries(entry(10), entry(8), entry(7.999), entry(9))])
    assert times(got) == [8, 9, 10]
    assert order.late == 1


def test_what_is_older_than_a_released_one_is_late():
    """Time never runs backwards at the exit, even after a release by the clock."""
    order = Reorder(1)
    order.push(entries(entry(10)), 0.0)
    assert times(rows_of(order.release(0.0))) == [10]
    assert times(through(order, [entries(entry(9.5), entry(10.5))])) == [10.5]
    assert order.late == 1


@pytest.mark.parametrize(
    "bad",
    [
        pytest.param({"pv": NAN, "sp": NAN, "op": NAN}, id="nothing"),
        pytest.param({"pv": NAN}, id="no-pv"),
        pytest.param({"op": NAN}, id="no-op"),
        pytest.param({"pv": math.inf}, id="infinite"),
        pytest.param({"quality": 0}, id="bad-quality"),
        pytest.param({"kind": TAG_AUTO, "auto": MODE_UNKNOWN}, id="mode-not-read"),
        pytest.param({"kind": TAG_SP, "sp": NAN}, id="tag-without-value"),
        pytest.param({"kind": TAG_PV, "quality": 0}, id="bad-tag"),
    ],
)
@pytest.mark.parametrize("times_over", [1, HELD_ENTRIES + 10])
def test_a_bad_entry_never_moves_the_window(bad, times_over):
    """Bad entries half a minute ahead, few or more than are held: the good ones behind them are not late."""
    order = Reorder(1)
    ahead = [entry(30 + 0.1 * k, **bad) for k in range(times_over)]
    good = [entry(t) for t in (1, 2, 3, 2.5, 4)]
    got = order.push(entries(entry(0), *ahead), 0.0)
    assert len(order.release(-1.0)) == 0
    got = join([got, order.push(entries(*good), 0.0), order.release(0.0), order.push(entries(entry(5)), 1.0)])
    assert order.late == 0
    assert [t for t in times(rows_of(got)) if t < 30] == [0, 1, 2, 2.5, 3, 4]
    if bad.get("kind", TAG_PV) in {SAMPLE, TAG_PV}:
        assert len(rows_of(got)) == 6 + times_over


def test_bad_entries_let_go_by_the_clock_do_not_make_good_ones_late():
    """A loop that has sent only bad samples for a while takes the next good one, wherever its time lies."""
    order = Reorder(1)
    order.push(entries(entry(0)), 0.0)
    order.push(entries(*(entry(t, pv=NAN) for t in range(1, 50))), 10.0)
    order.release(10.0)
    order.push(entries(entry(20)), 11.0)
    assert order.late == 0


@pytest.mark.parametrize("rate", [25, 100, 1000])
def test_a_fast_loop_has_the_room_that_its_window_needs(rate):
    """Tags of 25 to 1000 samples a second, disturbed over the whole window: sorted, none late, none let go early."""
    n = 3 * rate
    kinds = (TAG_SP, TAG_OP, TAG_PV) if rate < 1000 else (TAG_PV,)
    rows = [entry(k / rate, kind, sp=k, pv=k, op=k) for k in range(n) for kind in kinds]
    delay = np.random.default_rng(rate).uniform(0, 1.99, len(rows))
    order = np.argsort([(r[0] - T0) / SECOND + d for r, d in zip(rows, delay, strict=True)])
    arrived = entries(*(rows[k] for k in order))
    o = Reorder(2)
    got = through(o, np.array_split(arrived, 7))
    assert [r[3] for r in got] == list(range(n))
    assert all(r[2] == r[4] == r[3] for r in got if len(kinds) > 1)
    assert (o.late, o.overflow, o.waiting) == (0, 0, 0)
    assert len(through(o, [entries(entry(1, loop=1))])) == 1


def test_more_than_there_is_room_for_shortens_the_window_and_is_counted(monkeypatch):
    """Faster than any room, or too many such loops: all in order go through, and what had to go early is counted."""
    monkeypatch.setattr("monitor.service.reorder.WIDE_LOOPS", 0)
    order = Reorder(1)
    fast = entries(*(entry(0.01 * k) for k in range(300)))
    got = through(order, [fast[k : k + 7] for k in range(0, 300, 7)])
    assert times(got) == sorted(times(got))
    assert len(got) == 300
    assert order.late == 0
    assert order.overflow > 0
    order = Reorder(1)
    got = through(order, [entries(entry(0.5), *fast[::-1].tolist())])
    assert len(got) + order.late + order.duplicate == 301
    assert order.overflow > 0


def test_an_old_one_into_a_full_house_stays_in_order(monkeypatch):
    """With all room taken an entry older than all of it goes out first."""
    monkeypatch.setattr("monitor.service.reorder.WIDE_LOOPS", 0)
    order = Reorder(1)
    full = entries(*(entry(1.0 + 0.01 * k) for k in range(HELD_ENTRIES)))
    first = order.push(full, 0.0)
    got = rows_of(join([first, order.push(entries(entry(0.5)), 0.0), order.release(0.0)]))
    assert len(got) == HELD_ENTRIES + 1
    assert times(got) == sorted(times(got))


# ---------------------------------------------------------------------------------------------------
# tags


def test_a_sample_is_made_at_each_pv_of_the_latest_others():
    """SP, OP and mode at or before the PV's time, held without limit; one at the same time counts."""
    order = Reorder(1)
    got = through(
        order,
        [
            entries(
                entry(0, TAG_SP, sp=50.0), entry(0, TAG_OP, op=10.0), entry(0, TAG_PV, pv=1.0),
                entry(5, TAG_PV, pv=2.0), entry(5, TAG_OP, op=11.0), entry(6, TAG_AUTO, auto=0),
                entry(5.5, TAG_SP, sp=60.0),
                entry(4000, TAG_PV, pv=3.0),
            )
        ],
    )  # fmt: skip
    assert [r[2:6] for r in got] == [
        (50.0, 1.0, 10.0, True),
        (50.0, 2.0, 11.0, True),
        (60.0, 3.0, 11.0, False),
    ]


def test_a_bad_tag_leaves_the_last_good_one():
    """Bad quality, no value, a mode that could not be read: what was known holds."""
    order = Reorder(1)
    got = through(
        order,
        [
            entries(
                entry(0, TAG_SP, sp=50.0), entry(0, TAG_OP, op=10.0), entry(0, TAG_AUTO, auto=0),
                entry(1, TAG_SP, sp=99.0, quality=0), entry(1, TAG_OP, op=NAN), entry(1, TAG_AUTO, auto=MODE_UNKNOWN),
                entry(2, TAG_PV, pv=1.0),
            )
        ],
    )  # fmt: skip
    assert got[0][2:6] == (50.0, 1.0, 10.0, False)


def test_of_equal_times_the_first_is_kept():
    """Two set points or samples at one instant: the first to come, be it good or bad; differences are counted."""
    order = Reorder(1)
    got = through(order, [entries(entry(0, TAG_SP, sp=1.0), entry(0, TAG_SP, sp=2.0), entry(0, TAG_PV))])
    assert got[0][2] == 1.0
    for first in (1.0, NAN):
        order = Reorder(1)
        got = through(
            order, [entries(entry(0, pv=first), entry(0, pv=2.0), entry(0, pv=first)), entries(entry(1))]
        )
        assert [r[3] for r in got] == [None if math.isnan(first) else first, 2.0]
        assert times(got) == [0, 1]
        assert (order.duplicate, order.conflict) == (2, 1)


def test_a_repeat_of_what_has_gone_out_is_dropped():
    """The clock let go of a sample, and then it comes again."""
    order = Reorder(1)
    order.push(entries(entry(0, pv=NAN), entry(1)), 0.0)
    assert times(rows_of(order.release(0.0))) == [0, 1]
    assert times(through(order, [entries(entry(1), entry(1, pv=7.0), entry(2))])) == [2]
    assert (order.duplicate, order.conflict, order.late) == (2, 1, 0)


# ---------------------------------------------------------------------------------------------------
# clocks


def test_a_clock_that_is_set_back_is_followed_after_a_while():
    """An hour back: late for half a minute, then taken as it is; what was held goes out first, and it is said when."""
    order = Reorder(1)
    out = [order.push(entries(entry(3600 + k)), k) for k in range(10)]
    found = []
    for k in range(60):
        out.append(order.push(entries(entry(10 + k)), 10.0 + k))
        found += [(len(out) - 1, n, loop, (first - T0) / SECOND) for n, loop, first in order.stepped]
    out.append(order.release(math.inf))
    assert found == [(40, 3, 0, 10.0)]
    got = times(rows_of(join(out)))
    assert got == [3600 + k for k in range(10)] + [40 + k for k in range(30)]
    assert (order.late, order.steps) == (30, 1)


def test_tags_follow_a_clock_that_is_set_back():
    """The set point's earlier times hold again."""
    order = Reorder(1)
    order.push(entries(entry(3600, TAG_SP, sp=1.0), entry(3600, TAG_OP, op=1.0), entry(3600, TAG_PV)), 0.0)
    out = []
    for k in range(50):
        tags = [entry(k, kind, sp=k, op=k) for kind in (TAG_SP, TAG_OP, TAG_PV)]
        out.append(order.push(entries(*tags), float(k)))
    got = rows_of(join([*out, order.release(math.inf)]))
    assert [r[2] for r in got[-5:]] == [45.0, 46.0, 47.0, 48.0, 49.0]
    assert order.steps == 1


def test_a_replayed_batch_and_stragglers_are_late():
    """Old ones in a burst, or between those of today, never turn time back; bad ones do not count for it."""
    order = Reorder(1)
    order.push(entries(entry(3600)), 0.0)
    order.push(entries(*(entry(k) for k in range(1000))), 20.0)
    order.push(entries(entry(3630)), 30.0)
    for k in range(100):
        order.push(entries(entry(3631 + k), entry(k)), 31.0 + k)
    late = order.late
    for k in range(100):
        order.push(entries(entry(5 + k, pv=NAN), entry(5 + k, TAG_SP, sp=NAN)), 200.0 + k)
    assert order.steps == 0
    assert late == 1100
    assert order.late == late + 200


def test_a_late_set_point_holds_from_then_on():
    """A set point that last changed hours ago and arrives after the first PV is not lost; an older one is."""
    order = Reorder(1)
    got = through(
        order,
        [
            entries(entry(10_000, TAG_PV), entry(0, TAG_OP, op=5.0), entry(0, TAG_SP, sp=7.0)),
            entries(entry(10_001, TAG_PV), entry(-5, TAG_SP, sp=1.0), entry(10_002, TAG_PV)),
        ],
    )
    assert [r[2] for r in got] == [7.0, 7.0, 7.0]
    assert order.late == 1


# ---------------------------------------------------------------------------------------------------
# wall time, loops


def test_release_by_the_clock_lets_go_of_idle_loops_only():
    """A loop with something newer since then keeps what it holds."""
    order = Reorder(2)
    order.push(entries(entry(0, loop=0)), 100.0)
    order.push(entries(entry(0, loop=1)), 101.5)
    assert [r[0] for r in rows_of(order.release(100.0))] == [0]
    assert order.waiting == 1
    assert len(order.release(100.0)) == 0


def test_grow_keeps_what_is_held():
    """More loops, and later; fewer is nothing."""
    order = Reorder(1)
    order.push(entries(entry(0, TAG_SP, sp=5.0), entry(0, TAG_PV)), 0.0)
    order.grow(3)
    order.grow(2)
    assert len(order.state) == 3
    got = through(order, [entries(entry(1, loop=2), entry(1, TAG_PV))])
    assert [(r[0], r[2]) for r in sorted(got)] == [(0, 5.0), (0, 5.0), (2, 1.0)]


def test_loops_have_windows_of_their_own():
    """A loop whose clock is ahead makes none of another's samples late."""
    order = Reorder(2)
    got = through(
        order, [entries(entry(1000, loop=0), entry(1, loop=1), entry(999, loop=0), entry(0.5, loop=1))]
    )
    assert order.late == 0
    assert [(r[0], t) for r, t in zip(by_loop(got), times(by_loop(got)), strict=True)] == [
        (0, 999.0), (0, 1000.0), (1, 0.5), (1, 1.0),
    ]  # fmt: skip
