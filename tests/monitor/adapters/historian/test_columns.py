"""Columns: what a file's first rows say of all of them, and rows that say otherwise."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from monitor.adapters.historian.rows import Tally, UnusableError
from tests.monitor.adapters.historian.tools import (
    NAMES,
    SECOND,
    all_of,
    as_text,
    equal,
    frame,
    samples_of,
    sources,
    wide,
    write,
)


def test_absent_auto_and_quality_mean_automatic_and_good(tmp_path: Path) -> None:
    got = all_of(write(frame(auto=False, quality=False), tmp_path / "d.parquet"))
    assert got.auto.all()
    assert (got.quality == 192).all()


def test_mode_is_held_where_a_row_does_not_say(tmp_path: Path) -> None:
    data = frame(quality=False).query("loop == @NAMES[0]").head(6)
    given_modes, held = ["", "MAN", "", "", "CAS", ""], [True, False, False, False, True, True]
    shuffled = data.assign(auto=given_modes).iloc[[5, 0, 4, 1, 3, 2]]
    assert all_of(write(shuffled, tmp_path / "d.csv")).auto.tolist() == held
    assert all_of(write(shuffled.replace("", None), tmp_path / "d.parquet")).auto.tolist() == held


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
@pytest.mark.parametrize("shape", ["long", "wide"])
def test_set_point_and_output_written_only_on_change_are_held(
    tmp_path: Path, shape: str, suffix: str
) -> None:
    """Held in the order of time, whatever the order of rows; a PV is never invented."""
    data = frame(quality=False)
    for name in NAMES:
        own = data["loop"] == name
        data.loc[own, "sp"] = np.where(np.arange(own.sum()) < 15, 50.0, 55.0)
        data.loc[own, "op"] = np.floor(np.arange(own.sum()) / 4)
    changed = data.groupby("loop")[["sp", "op"]].diff().ne(0)
    cells = data.assign(sp=data["sp"].where(changed["sp"]), op=data["op"].where(changed["op"]))
    cells.loc[[16, 17], "pv"] = np.nan  # where OP is written: a wide row with nothing in it is none
    wanted = samples_of(data.assign(pv=cells["pv"]))
    shaped = wide(cells) if shape == "wide" else cells
    for k, rows in enumerate((shaped, shaped[::-1])):
        tally = Tally()
        path = write(rows, tmp_path / f"d{k}{suffix}")
        assert sources(path)[0].sparse
        equal(all_of(path, tally=tally), wanted)
        assert tally.bad_texts == (2 if suffix == ".csv" else 0)
    assert not sources(write(data, tmp_path / f"full{suffix}"))[0].sparse


def test_times_of_1970_and_1900_are_bad_rows_among_times_of_day(tmp_path: Path) -> None:
    data = frame()
    for k, zero in enumerate([0, -2_208_988_800 * SECOND]):
        broken = data.assign(time=data["time"].where(data.index != 7, zero))
        for time, suffix in (("s", ".csv"), ("timestamp", ".parquet"), ("text", ".csv"), ("ns", ".parquet")):
            tally = Tally()
            got = all_of(write(broken, tmp_path / f"{time}{k}{suffix}", time), tally=tally)
            equal(got, samples_of(data.drop(index=7)))
            assert tally.bad_time == 1


def test_units_mixed_later_in_a_file_refuse_it(tmp_path: Path) -> None:
    data = frame(70_000)
    data["time"] = data["time"] / 1e9
    data.loc[len(data) - 1, "time"] *= 1000
    data.to_csv(tmp_path / "d.csv", index=False)
    with pytest.raises(UnusableError, match=r"d\.csv: time: s and ms since 1970 mixed"):
        all_of(tmp_path / "d.csv")


@pytest.mark.parametrize(
    "text", ["2016-12-31T23:59:60Z", "yesterday", "", "2026-02-30T00:00:00Z", "2500-01-01T00:00:00Z"]
)
def test_a_time_that_is_none_costs_its_row_only(tmp_path: Path, text: str) -> None:
    data = frame()
    cells = as_text(data)
    cells.loc[7, "time"] = text
    cells.to_csv(tmp_path / "d.csv", index=False)
    tally = Tally()
    equal(all_of(tmp_path / "d.csv", tally=tally), samples_of(data.drop(index=7)))
    assert tally.bad_time == 1
    assert tally.times == {text}


def test_times_with_and_without_zone_in_one_file_refuse_it(tmp_path: Path) -> None:
    cells = as_text(frame())
    cells.loc[5, "time"] = "2026-03-01 00:00:02"
    cells.to_csv(tmp_path / "d.csv", index=False)
    with pytest.raises(UnusableError, match="with and without zone mixed"):
        all_of(tmp_path / "d.csv")
