"""Layouts: long, wide, a file a loop; headings in any case."""

from __future__ import annotations

from pathlib import Path

import pandas as pd
import pytest

from monitor.adapters.historian.reader import inspect
from monitor.adapters.historian.rows import Tally
from tests.monitor.adapters.historian.tools import (
    NAMES,
    SECOND,
    all_of,
    equal,
    frame,
    samples_of,
    sources,
    wide,
    write,
)


@pytest.mark.parametrize("layout", ["long", "wide"])
def test_columns_in_any_case(tmp_path: Path, layout: str) -> None:
    data = frame()
    shaped = data.rename(columns=str.upper) if layout == "long" else wide(data, lower=True)
    shaped = shaped.rename(columns={"TIME": "time"})
    path = write(shaped, tmp_path / "d.csv").rename(tmp_path / "e.csv")
    path.write_text(path.read_text().replace("time", "Time", 1))
    equal(all_of(path), samples_of(data))


def test_wide_loops_on_different_times_have_only_their_own_samples(tmp_path: Path) -> None:
    """Cells that are empty because another loop's row stands there are no samples, let alone bad ones."""
    data = frame()
    data = data[(data["loop"] == NAMES[0]) | (data["time"] % (4 * SECOND) == 0)]
    parts = [p.drop(columns="loop").set_index("time").add_prefix(f"{n}.") for n, p in data.groupby("loop")]
    joined = pd.concat(parts, axis=1).reset_index()
    for suffix in (".csv", ".parquet"):
        tally = Tally()
        equal(all_of(write(joined, tmp_path / f"w{suffix}"), tally=tally), samples_of(data))
        assert tally.rows == len(data)
        assert not tally.bad_texts


def test_wide_loop_without_op_is_named_and_left_out(tmp_path: Path) -> None:
    shaped = wide(frame()).drop(columns=f"{NAMES[1]}.OP")
    (source,) = sources(write(shaped, tmp_path / "w.csv"))
    assert source.loops == [NAMES[0]]
    assert source.layout.incomplete == {NAMES[1]: f"no column {NAMES[1]}.OP"}


def test_percent_encoded_file_name_is_a_loop_name(tmp_path: Path) -> None:
    data = frame().query("loop == @NAMES[0]").drop(columns="loop")
    (source,) = sources(write(data, tmp_path / "A%2FB.csv"))
    assert source.loops == ["A/B"]
    assert inspect(source.path, names=["A%2FB"]).loops == ["A%2FB"]
