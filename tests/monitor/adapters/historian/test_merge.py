"""Rows in order: files merged, sorted, of equal times the first."""

from __future__ import annotations

import threading
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from monitor.adapters.historian import merge
from monitor.adapters.historian.merge import OutOfOrderError, Span, in_order, sorted_samples
from monitor.adapters.historian.rows import Tally
from tests.monitor.adapters.historian.tools import (
    SECOND,
    START,
    WANTED,
    all_of,
    by_loop,
    equal,
    frame,
    samples_of,
    sources,
    write,
)
from tests.support.samples import join


@settings(max_examples=25)
@given(seed=st.integers(0, 2**32 - 1), files=st.integers(1, 4), repeats=st.integers(0, 30))
def test_shuffled_split_and_repeated_rows_change_nothing(
    tmp_path_factory: pytest.TempPathFactory, seed: int, files: int, repeats: int
) -> None:
    folder = tmp_path_factory.mktemp("s")
    rng = np.random.default_rng(seed)
    data = frame()
    mixed = pd.concat([data, data.iloc[rng.integers(0, len(data), repeats)]])
    mixed = mixed.iloc[rng.permutation(len(mixed))]
    which = rng.integers(0, files, len(mixed))
    paths = [write(mixed[which == k], folder / f"{k}.parquet") for k in range(files) if (which == k).any()]
    tally = Tally()
    equal(all_of(*paths, tally=tally), samples_of(data))
    assert tally.duplicate == repeats
    assert tally.conflict == 0
    assert tally.rows == len(data) + repeats


def test_first_of_equal_times_is_kept_and_conflicts_are_counted(tmp_path: Path) -> None:
    data = frame()
    again = data.iloc[[3, 4, 5]].assign(pv=[1.0, data["pv"][4], np.nan])
    ordered = pd.concat([data, again]).sort_values("time", kind="stable")
    for k, order in enumerate([pd.concat([data, again]), ordered]):
        tally = Tally()
        equal(all_of(write(order, tmp_path / f"{k}.csv"), tally=tally), samples_of(data))
        assert (tally.duplicate, tally.conflict) == (3, 2)
    tally = Tally()
    equal(by_loop(join(list(in_order(sources(tmp_path / "1.csv"), WANTED, Span(), tally)))), samples_of(data))
    assert (tally.duplicate, tally.conflict) == (3, 2)


def test_a_repeated_bad_sample_is_no_conflict(tmp_path: Path) -> None:
    data = frame()
    data.loc[4, "pv"] = np.nan
    tally = Tally()
    equal(all_of(write(pd.concat([data, data.iloc[[4]]]), tmp_path / "d.csv"), tally=tally), samples_of(data))
    assert (tally.duplicate, tally.conflict) == (1, 0)


def test_the_first_is_kept_among_thousands(tmp_path: Path) -> None:
    """A sort that is not stable would show only here."""
    data = frame(3000)
    others = data.assign(pv=-1.0)[::-1]
    equal(all_of(write(pd.concat([data[::-1], others, others]), tmp_path / "d.parquet")), samples_of(data))


def test_a_first_bad_sample_shuts_out_a_later_good_one_of_its_time(tmp_path: Path) -> None:
    data = frame()
    bad = data.assign(pv=data["pv"].where(data.index != 4))
    tally = Tally()
    equal(all_of(write(pd.concat([bad, data.iloc[[4]]]), tmp_path / "d.csv"), tally=tally), samples_of(bad))
    assert (tally.duplicate, tally.conflict) == (1, 1)


def test_reversed_and_overlapping_files(tmp_path: Path) -> None:
    data = frame()
    reverse = write(data[::-1], tmp_path / "r.parquet")
    equal(all_of(reverse), samples_of(data))
    a, b = write(data[:50], tmp_path / "a.csv"), write(data[30:], tmp_path / "b.csv")
    for paths in ([a, b], [b, a]):
        tally = Tally()
        equal(all_of(*paths, tally=tally), samples_of(data))
        assert tally.duplicate == 20


def test_order_is_told_per_loop(tmp_path: Path) -> None:
    """Loop after loop streams; a row that goes back does not."""
    data = frame()
    stacked = data.sort_values(["loop", "time"])
    found = sources(write(stacked, tmp_path / "d.parquet"))
    equal(by_loop(join(list(in_order(found, WANTED, Span(), Tally())))), samples_of(data))
    swapped = stacked.iloc[[1, 0, *range(2, len(stacked))]]
    with pytest.raises(OutOfOrderError):
        list(in_order(sources(write(swapped, tmp_path / "e.parquet")), WANTED, Span(), Tally()))


def test_sorting_some_loops_at_a_time_gives_the_same(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    data = frame()
    found = sources(write(data[::-1], tmp_path / "d.parquet"))
    monkeypatch.setattr(merge, "MOST_SORTED_ROWS", 10)
    monkeypatch.setattr(merge, "BATCH_ROWS", 7)
    tally = Tally()
    parts = list(sorted_samples(found, WANTED, Span(), tally))
    assert len(parts) > 4
    equal(by_loop(join(parts)), samples_of(data))
    assert tally.rows == len(data)
    assert not tally.unknown


def test_since_and_until_are_half_open(tmp_path: Path) -> None:
    data = frame()
    span = Span(START + 5 * SECOND, START + 20 * SECOND)
    inside = data[(data["time"] >= span.since) & (data["time"] < span.until)]
    tally = Tally()
    equal(all_of(write(data, tmp_path / "d.csv"), span=span, tally=tally), samples_of(inside))
    assert tally.outside == len(data) - len(inside)


def test_reading_thread_ends_with_its_consumer(tmp_path: Path) -> None:
    found = sources(write(frame(200_000), tmp_path / "d.parquet"))
    stream = in_order(found, WANTED, Span(), Tally())
    next(stream)
    stream.close()
    assert not [t for t in threading.enumerate() if t.name.startswith("historian")]
