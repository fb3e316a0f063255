"""Historian exports: the same data in any layout, format, order and state of repair."""

from __future__ import annotations

import threading
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from monitor.adapters.historian import merge
from monitor.adapters.historian.cells import modes, numbers, qualities
from monitor.adapters.historian.clock import EXCEL_EPOCH, clock_of_numbers, numbers_to_ns, to_utc, zone_of
from monitor.adapters.historian.merge import OutOfOrderError, Span, in_order, load, sorted_samples
from monitor.adapters.historian.reader import inspect, read, scan
from monitor.adapters.historian.rows import Tally, UnusableError
from monitor.adapters.historian.source import MOST_COLUMNS, Source
from monitor.contract.samples import Samples, join

START = np.datetime64("2026-03-01T00:00:00", "ns").astype(np.int64)
SECOND = 10**9
FIELDS = ("loop", "time", "sp", "pv", "op", "auto", "quality")
NAMES = ("LIC-101", "FIC 2.A")


def frame(n: int = 40, seed: int = 0, auto: bool = True, quality: bool = True) -> pd.DataFrame:
    """Two loops of n rows, interleaved, one second apart."""
    rng = np.random.default_rng(seed)
    parts = []
    for name in NAMES:
        part = pd.DataFrame({"loop": name, "time": START + SECOND * np.arange(n)})
        for column in ("sp", "pv", "op"):
            part[column] = rng.normal(50, 10, n).round(3)
        if auto:
            part["auto"] = rng.random(n) > 0.3
        if quality:
            part["quality"] = rng.choice([0, 64, 192, 216], n)
        parts.append(part)
    return pd.concat(parts).sort_values(["time", "loop"], kind="stable").reset_index(drop=True)


def samples_of(data: pd.DataFrame) -> Samples:
    """What a reader has to make of it: by loop, then time."""
    data = data.assign(code=data["loop"].map(NAMES.index)).sort_values(["code", "time"], kind="stable")
    return Samples.of(
        data["code"], data["time"], data["sp"], data["pv"], data["op"],
        data.get("auto"), data.get("quality"),
    )  # fmt: skip


def as_text(data: pd.DataFrame) -> pd.DataFrame:
    return data.assign(time=pd.to_datetime(data["time"]).dt.strftime("%Y-%m-%dT%H:%M:%S.%fZ"))


def wide(data: pd.DataFrame, lower: bool = False) -> pd.DataFrame:
    out: pd.DataFrame | None = None
    for name, part in data.groupby("loop"):
        roles = {c: f"{name}.{c if lower else c.upper()}" for c in part.columns if c not in {"loop", "time"}}
        own = part.drop(columns="loop").rename(columns=roles)
        out = own if out is None else out.merge(own, on="time")
    assert out is not None
    return out


def write(data: pd.DataFrame, path: Path, time: str = "timestamp", **options: object) -> Path:
    data = data.copy()
    if time == "timestamp":
        data["time"] = pd.to_datetime(data["time"], utc=True)
    elif time == "text":
        data = as_text(data)
    elif time == "naive":
        data["time"] = pd.to_datetime(data["time"]).dt.strftime("%Y-%m-%d %H:%M:%S.%f")
    elif time == "excel":
        data["time"] = data["time"] / 86_400e9 + EXCEL_EPOCH
    else:
        data["time"] = data["time"] / {"s": 1e9, "ms": 1e6, "us": 1e3}[time] if time != "ns" else data["time"]
    if path.suffix == ".parquet":
        data.to_parquet(path, index=False)
    else:
        data.to_csv(path, index=False, **options)  # type: ignore[call-overload]
    return path


def sources(*paths: Path, unit: str | None = None) -> list[Source]:
    return [inspect(p, p.name, NAMES, unit) for p in paths]


WANTED = {name: k for k, name in enumerate(NAMES)}


def all_of(
    *paths: Path, span: Span | None = None, tally: Tally | None = None, unit: str | None = None
) -> Samples:
    tally = Tally() if tally is None else tally
    return load(sources(*paths, unit=unit), WANTED, span or Span(), tally)


def equal(a: Samples, b: Samples) -> None:
    assert len(a) == len(b)
    for name in FIELDS:
        np.testing.assert_array_equal(getattr(a, name), getattr(b, name), err_msg=name)


def by_loop(samples: Samples) -> Samples:
    return samples.take(np.lexsort((samples.time, samples.loop)))


# -- layouts, formats, times ----------------------------------------------------------------------


@pytest.mark.parametrize("time", ["timestamp", "text", "naive", "s", "ms", "us", "ns", "excel"])
@pytest.mark.parametrize("suffix", [".parquet", ".csv"])
@pytest.mark.parametrize("layout", ["long", "per loop", "wide"])
def test_same_data_give_same_samples(tmp_path: Path, layout: str, suffix: str, time: str) -> None:
    """Layout, format and the way of writing time change nothing; streaming equals sorting."""
    data = frame()
    if layout == "long":
        paths = [write(data, tmp_path / f"data{suffix}", time)]
    elif layout == "wide":
        paths = [write(wide(data), tmp_path / f"wide{suffix}", time)]
    else:
        paths = [
            write(p.drop(columns="loop"), tmp_path / f"{n}{suffix}", time) for n, p in data.groupby("loop")
        ]
    found = sources(*paths)
    assert {s.layout.kind for s in found} == {layout}
    tally = Tally()
    equal(load(found, WANTED, Span(), tally), samples_of(data))
    equal(by_loop(join(list(in_order(found, WANTED, Span(), Tally())))), samples_of(data))
    assert tally.rows == len(data)
    assert tally.loop_rows == dict.fromkeys(NAMES, 40)
    assert not tally.bad_time


@pytest.mark.parametrize("layout", ["long", "wide"])
def test_columns_in_any_case(tmp_path: Path, layout: str) -> None:
    data = frame()
    shaped = data.rename(columns=str.upper) if layout == "long" else wide(data, lower=True)
    shaped = shaped.rename(columns={"TIME": "time"})
    path = write(shaped, tmp_path / "d.csv").rename(tmp_path / "e.csv")
    path.write_text(path.read_text().replace("time", "Time", 1))
    equal(all_of(path), samples_of(data))


def test_absent_auto_and_quality_mean_automatic_and_good(tmp_path: Path) -> None:
    got = all_of(write(frame(auto=False, quality=False), tmp_path / "d.parquet"))
    assert got.auto.all()
    assert (got.quality == 192).all()


@pytest.mark.parametrize("dtype", ["float32", "int64", "str", "category"])
def test_values_of_any_column_type(tmp_path: Path, dtype: str) -> None:
    data = frame().assign(sp=50, pv=7, op=12)
    path = write(data.astype({"sp": dtype, "pv": dtype, "op": dtype}), tmp_path / "d.parquet")
    equal(all_of(path), samples_of(data))


def test_loop_column_as_dictionary_or_number(tmp_path: Path) -> None:
    data = frame()
    equal(all_of(write(data.astype({"loop": "category"}), tmp_path / "d.parquet")), samples_of(data))
    numbered = data.assign(loop=data["loop"].map(NAMES.index))
    found = sources(write(numbered, tmp_path / "n.parquet"))
    assert set().union(*scan(found[0])) == {"0", "1"}
    equal(load(found, {"0": 0, "1": 1}, Span(), Tally()), samples_of(data))


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


# -- order, repeats -------------------------------------------------------------------------------


@settings(max_examples=25, deadline=None)
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
    monkeypatch.setattr(merge, "MOST_SORTED", 10)
    monkeypatch.setattr(merge, "STEP", 7)
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


# -- cells ------------------------------------------------------------------------------------------


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


def test_semicolons_decimal_commas_bom_and_crlf(tmp_path: Path) -> None:
    data = frame()
    path = write(
        data, tmp_path / "d.csv", "text", sep=";", decimal=",", lineterminator="\r\n", encoding="utf-8-sig"
    )
    assert b"," in path.read_bytes()
    tally = Tally()
    equal(all_of(path, tally=tally), samples_of(data))
    assert not tally.bad_texts
    dotted = path.read_text(encoding="utf-8-sig").replace("2026-03-01T", "01.03.2026 ").replace("Z;", ";")
    path.write_text(dotted, encoding="utf-16")
    equal(all_of(path), samples_of(data))


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


# -- times ------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("unit", "scale"), [("s", 1.0), ("ms", 1e3), ("us", 1e6), ("ns", 1e9)])
def test_unit_of_numeric_times_by_range(unit: str, scale: float) -> None:
    assert clock_of_numbers(np.array([1.7e9, 1.7e9 + 60]) * scale).unit == unit
    assert clock_of_numbers(np.array([3e9, 3e9 + 1]) * scale).unit == unit  # 2065


def test_seconds_from_a_start_and_spreadsheet_days() -> None:
    relative = clock_of_numbers(np.arange(1000.0))
    assert (relative.unit, relative.epoch) == ("s", False)
    assert clock_of_numbers(45_000 + np.arange(100) / 86_400).unit == "excel"
    assert clock_of_numbers(np.arange(40_000.0, 50_000.0)).unit == "s"
    assert clock_of_numbers(45_000 + np.arange(100) / 86_400, "s").unit == "s"


@pytest.mark.parametrize(
    "values", [[45_000.0, 45_000.1, 45_000.2], [45_000.0], [1.7e9, 1.7e12], [1e10, 1e10 + 1]]
)
def test_ambiguous_times_name_the_option(values: list[float]) -> None:
    with pytest.raises(ValueError, match="--time-unit"):
        clock_of_numbers(np.array(values))


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


@pytest.mark.parametrize("year", [1995, 2039, 2150])
def test_years_far_from_today(tmp_path: Path, year: int) -> None:
    data = frame()
    data["time"] += np.datetime64(f"{year}-03-01", "ns").astype(np.int64) - START
    for suffix in (".csv", ".parquet"):
        equal(all_of(write(data, tmp_path / f"d{suffix}")), samples_of(data))


def test_float_seconds_are_rounded_to_microseconds() -> None:
    t = np.array([1.7e9 + 0.1, 1.7e9 + 0.25])
    ns, good = numbers_to_ns(t, clock_of_numbers(t))
    assert ns.tolist() == [1_700_000_000_100_000_000, 1_700_000_000_250_000_000]
    assert good.all()


def test_integer_nanoseconds_keep_every_digit(tmp_path: Path) -> None:
    data = frame()
    data["time"] += np.arange(len(data)) % 7
    for suffix in (".csv", ".parquet"):
        equal(all_of(write(data, tmp_path / f"d{suffix}", "ns")), samples_of(data))


def test_naive_times_are_read_in_the_zone(tmp_path: Path) -> None:
    data = frame()
    path = write(data, tmp_path / "d.csv", "naive")
    (source,) = sources(path)
    assert source.clock.naive
    berlin = all_of(path, span=Span(zone=zone_of("Europe/Berlin")))
    equal(berlin, samples_of(data.assign(time=data["time"] - 3600 * SECOND)))
    aware = write(data, tmp_path / "e.csv", "text")
    equal(all_of(aware, span=Span(zone=zone_of("Europe/Berlin"))), samples_of(data))


BERLIN = zone_of("Europe/Berlin")
AUTUMN = np.datetime64("2026-10-25T00:00:00", "ns").astype(np.int64)  # UTC; the hour 02:00 local comes twice


@pytest.mark.parametrize("order", ["interleaved", "by loop", "reversed"])
def test_repeated_hour_is_told_apart_by_order(tmp_path: Path, order: str) -> None:
    """Three hours every ten minutes, across the change: no time goes back, none is lost."""
    n = 18
    data = frame(n).assign(time=np.repeat(AUTUMN - 1800 * SECOND + 600 * SECOND * np.arange(n), 2))
    local = pd.to_datetime(data["time"], utc=True).dt.tz_convert("Europe/Berlin").dt.tz_localize(None)
    cells = data.assign(time=local.dt.strftime("%Y-%m-%d %H:%M:%S"))
    assert local.duplicated(keep=False).sum() > n
    if order == "by loop":
        cells = cells.sort_values("loop", kind="stable")
    if order == "reversed":
        cells = cells[::-1]
    cells.to_csv(tmp_path / "d.csv", index=False)
    tally = Tally()
    equal(all_of(tmp_path / "d.csv", span=Span(zone=BERLIN), tally=tally), samples_of(data))
    assert tally.duplicate == 0


def test_hour_seen_once_belongs_to_the_side_it_continues() -> None:
    minute = 60 * SECOND
    first = np.datetime64("2026-10-25T02:00", "ns").astype(np.int64) + minute * np.arange(60)
    code = np.zeros(120, np.int32)
    before, after = first - 60 * minute, first + 60 * minute
    assert BERLIN is not None
    went_on = to_utc(np.concatenate([before, first]), code, BERLIN)
    assert (np.diff(went_on) == minute).all()
    began = to_utc(np.concatenate([first, after]), code, BERLIN)
    assert (np.diff(began) == minute).all()


def test_missing_hour_is_an_error_with_its_line(tmp_path: Path) -> None:
    cells = frame(quality=False).assign(time="2026-03-29 01:59:00")
    cells.loc[6, "time"] = "2026-03-29 02:30:00"
    cells.to_csv(tmp_path / "d.csv", index=False)
    with pytest.raises(UnusableError) as caught:
        all_of(tmp_path / "d.csv", span=Span(zone=BERLIN))
    assert str(caught.value) == "d.csv:8: time: 2026-03-29 02:30:00 does not exist in Europe/Berlin"


def test_unknown_zone_is_refused() -> None:
    with pytest.raises(ValueError, match="--tz: 'Mars/Olympus'"):
        zone_of("Mars/Olympus")


def test_times_with_and_without_zone_in_one_file_refuse_it(tmp_path: Path) -> None:
    cells = as_text(frame())
    cells.loc[5, "time"] = "2026-03-01 00:00:02"
    cells.to_csv(tmp_path / "d.csv", index=False)
    with pytest.raises(UnusableError, match="with and without zone mixed"):
        all_of(tmp_path / "d.csv")


# -- damage -----------------------------------------------------------------------------------------


def test_lines_with_wrong_number_of_cells_are_counted_with_their_line(tmp_path: Path) -> None:
    data = frame()
    lines = as_text(data).to_csv(index=False).splitlines()
    lines[5] += ",9"
    torn = "\n".join(lines)[:-25]
    (tmp_path / "d.csv").write_text(torn)
    tally = Tally()
    equal(all_of(tmp_path / "d.csv", tally=tally), samples_of(data.drop(index=[4, 79])))
    assert tally.lost_lines == {"d.csv": 2}
    assert tally.lines["d.csv"] == {6: "8 cells, expected 7", 81: "3 cells, expected 7"}


def test_embedded_nul_costs_its_cell_only(tmp_path: Path) -> None:
    data = frame()
    text = as_text(data).to_csv(index=False)
    first = text.splitlines()[1]
    cells = first.split(",")
    cells[3] += "\0"
    (tmp_path / "d.csv").write_text(text.replace(first, ",".join(cells)))
    equal(all_of(tmp_path / "d.csv"), samples_of(data.assign(pv=data["pv"].where(data.index != 0))))


@pytest.mark.parametrize(
    ("name", "content", "reason"),
    [
        ("d.csv", b"", "an empty file"),
        ("d.csv", b"loop,time,sp,pv,op\n", "no rows"),
        ("d.csv", b"a,b\n1,2\n", "columns a, b, expected columns `loop, time"),
        ("d.csv", b"loop,time,sp,pv\nx,1,2,3\n", "expected columns `loop, time"),
        ("d.csv", b"name,kp\nx,1\n", "a loop table, not data"),
        ("d.csv", b"loop,time,time,sp,pv,op\nx,1,2,3,4,5\n", "twice"),
        ("d.csv", b"loop,time,sp,pv,op\nx,noon,3,4,5\n", "time: 'noon', expected ISO text"),
        ("d.parquet", b"PAR1 this is none PAR1", ""),
        ("d.parquet", b"not a parquet file at all", ""),
        ("d.txt", b"x", "suffix '.txt', expected .parquet or .csv"),
        ("d.csv", b"x," * (MOST_COLUMNS + 1) + b"\n", f"{MOST_COLUMNS + 2} columns, expected at most"),
        ("d.csv", b"x" * (17 << 20), "a line of more than 16 MB"),
        ("d.csv", b"loop,time,sp,pv,op\nx,1,2,3," + b"4" * (17 << 20), "a line of more than 16 MB"),
    ],
)
def test_unusable_file_says_why_in_one_line(tmp_path: Path, name: str, content: bytes, reason: str) -> None:
    (tmp_path / name).write_bytes(content)
    with pytest.raises(UnusableError) as caught:
        inspect(tmp_path / name, name)
    assert str(caught.value).startswith(f"{name}: ")
    assert reason in str(caught.value)
    assert "\n" not in str(caught.value)


def test_missing_file_says_so(tmp_path: Path) -> None:
    with pytest.raises(UnusableError, match="No such file"):
        inspect(tmp_path / "none.csv")


@settings(max_examples=60, deadline=None)
@given(data=st.data())
def test_flipped_bytes_never_crash(tmp_path_factory: pytest.TempPathFactory, data: st.DataObject) -> None:
    """A damaged file is read, counted or refused; nothing else is raised."""
    folder = tmp_path_factory.mktemp("f")
    suffix = data.draw(st.sampled_from([".csv", ".parquet"]))
    path = write(frame(quality=False), folder / f"d{suffix}")
    content = bytearray(path.read_bytes())
    for at in data.draw(st.lists(st.integers(0, len(content) - 1), max_size=8)):
        content[at] = data.draw(st.integers(0, 255))
    path.write_bytes(content[: data.draw(st.integers(1, len(content)))])
    try:
        all_of(path)
    except UnusableError as error:
        assert "\n" not in str(error)  # noqa: PT017


# -- names, rows, threads -----------------------------------------------------------------------------


HOSTILE = [
    "../../etc/x",
    "<script>alert(1)</script>",
    "=cmd()",
    "a/*/b",
    "\u202egnp.exe",
    "n" * 10_000,
    "[bold]x",
]


def test_names_are_data(tmp_path: Path) -> None:
    data = pd.concat([frame(5).assign(loop=name) for name in HOSTILE])
    (source,) = sources(write(data, tmp_path / "d.parquet"))
    assert set(scan(source)[0]) == set(HOSTILE)
    tally = Tally()
    list(read(source, {HOSTILE[2]: 0}, tally))
    assert tally.unknown == {n[:200] for n in HOSTILE if n != HOSTILE[2]}
    assert tally.rows == 10


def test_row_groups_can_be_read_by_themselves(tmp_path: Path) -> None:
    data = frame().sort_values(["loop", "time"], ascending=[False, True])
    table = pa.Table.from_pandas(data.assign(time=pd.to_datetime(data["time"])), preserve_index=False)
    pq.write_table(table, tmp_path / "d.parquet", row_group_size=10)
    (source,) = sources(tmp_path / "d.parquet")
    groups = [g for g, found in enumerate(scan(source)) if NAMES[1] in found]
    assert groups == [4, 5, 6, 7]
    rows = list(read(source, WANTED, Tally(), [0, 1, 6]))
    assert [r.row + k for r in rows for k in range(len(r))] == [*range(20), *range(60, 70)]
    got = join(list(in_order([source], {NAMES[1]: 0}, Span(), Tally(), {"d.parquet": groups})))
    equal(replace(got, loop=got.loop + 1), samples_of(data[data["loop"] == NAMES[1]]))


def test_reading_thread_ends_with_its_consumer(tmp_path: Path) -> None:
    found = sources(write(frame(200_000), tmp_path / "d.parquet"))
    stream = in_order(found, WANTED, Span(), Tally())
    next(stream)
    stream.close()
    assert not [t for t in threading.enumerate() if t.name.startswith("historian")]
