"""Cells: numbers, modes and qualities in every spelling and type."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest

from monitor.adapters.historian.cells import modes, numbers, qualities
from monitor.adapters.historian.rows import Tally
from tests.monitor.adapters.historian.tools import all_of, equal, frame, samples_of, write


@pytest.mark.parametrize("dtype", ["float32", "int64", "str", "category"])
def test_values_of_any_column_type(tmp_path: Path, dtype: str) -> None:
    data = frame().assign(sp=50, pv=7, op=12)
    path = write(data.astype({"sp": dtype, "pv": dtype, "op": dtype}), tmp_path / "d.parquet")
    equal(all_of(path), samples_of(data))


@pytest.mark.parametrize("text", ["Bad Input", "I/O Timeout", "No Data", "#N/A", "", "0x10", "1_000", "true"])
def test_text_among_values_is_a_bad_sample_and_counted(tmp_path: Path, text: str) -> None:
    data = frame()
    cells = data["pv"].astype(str)
    cells[[4, 9]] = text
    wanted = samples_of(data.assign(pv=data["pv"].where(~data.index.isin([4, 9]))))
    for suffix in (".csv", ".parquet"):
        tally = Tally()
        got = all_of(write(data.assign(pv=cells), tmp_path / f"d{suffix}"), tally=tally)
        equal(got, wanted)
        assert tally.texts == {text: 2}


def test_quoted_thousands_are_text_not_a_small_number() -> None:
    tally = Tally()
    assert np.isnan(numbers(pa.array(["1,234", "1.5", "x"]), tally)).tolist() == [True, False, True]
    assert numbers(pa.array(["1,234"]), tally, comma=True).tolist() == [1.234]


def test_modes_and_qualities_in_every_spelling() -> None:
    words = [
        "AUTO",
        "auto",
        "CAS",
        "RCAS",
        "1",
        "true",
        "MAN",
        "ROUT",
        "TRK",
        "IMAN",
        "OOS",
        "0",
        "",
        "weird",
        None,
    ]
    assert modes(pa.array(words), Tally()).tolist() == [1] * 6 + [0] * 6 + [-1] * 3
    assert modes(pa.array([True, False, None]), Tally()).tolist() == [1, 0, -1]
    assert modes(pa.array([1.0, 0.0, None]), Tally()).tolist() == [1, 0, -1]
    words = ["Good", "Bad", "Uncertain", "192", "24.0", "I/O Timeout", "", None, "Questionable"]
    tally = Tally()
    assert qualities(pa.array(words), tally).tolist() == [192, 0, 64, 192, 24, 0, 192, 192, 64]
    assert tally.qualities == {"Bad": 1, "Uncertain": 1, "24.0": 1, "I/O Timeout": 1, "Questionable": 1}
    assert qualities(pa.array([True, False, None]), Tally()).tolist() == [192, 0, 192]
    codes = [192, 216, 64, 0, None, 0x80000000, 0x40000000, 0x1C0, -1]
    tally = Tally()
    assert qualities(pa.array(codes), tally).tolist() == [192, 216, 64, 0, 192, 0, 64, 192, 0]
    assert tally.qualities == {"64": 1, "0": 1, "2147483648": 1, "1073741824": 1, "-1": 1}


def test_extreme_values_pass_unchanged(tmp_path: Path) -> None:
    """Judging them is the engine's: nothing is clipped or invented here."""
    data = frame()
    data.loc[:5, "pv"] = [np.inf, -np.inf, 1e38, 5e-324, -0.0, np.nan]
    for suffix in (".csv", ".parquet"):
        got = all_of(write(data, tmp_path / f"d{suffix}"))
        equal(got, samples_of(data))
        assert np.signbit(got.pv[got.pv == 0]).all()
