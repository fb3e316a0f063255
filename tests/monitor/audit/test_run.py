"""The audit as its user meets it: files in, tables out, the same bytes whoever does the work."""

from __future__ import annotations

from pathlib import Path

import pandas as pd
import pyarrow.parquet as pq
import pytest

from monitor.audit.inputs import expand
from monitor.audit.run import run_audit
from monitor.audit.settings import AuditSettings
from tests.monitor.audit.tools import FILES, about, content
from tests.support.places import SHARED

DATA = SHARED / "data"
needs_data = pytest.mark.skipif(
    not DATA.is_dir(), reason="the shared data sets are not beside this repository"
)


def test_row_order_and_format_change_no_table(fleet_data: pd.DataFrame, table: Path, tmp_path: Path) -> None:
    shuffled = fleet_data.sample(frac=1.0, random_state=1)
    for k, data in enumerate([fleet_data, shuffled, fleet_data.sort_values(["loop", "time"])]):
        data.to_parquet(tmp_path / f"{k}.parquet")
        run_audit([tmp_path / f"{k}.parquet"], table, tmp_path / f"o{k}")
    fleet_data[::-1].to_csv(tmp_path / "3.csv", index=False)
    run_audit([tmp_path / "3.csv"], table, tmp_path / "o3")
    first = content(tmp_path / "o0")
    for k in (1, 2, 3):
        other = content(tmp_path / f"o{k}")
        assert [other[f] for f in FILES[:3]] == [first[f] for f in FILES[:3]]


# -- what was left out ------------------------------------------------------------------------------
def test_damaged_files_are_left_out_and_the_rest_audited(
    fleet_data: pd.DataFrame, table: Path, tmp_path: Path
) -> None:
    folder = tmp_path / "in"
    folder.mkdir()
    fleet_data.to_parquet(folder / "good.parquet")
    (folder / "empty.csv").write_text("")
    cut = (folder / "good.parquet").read_bytes()
    (folder / "torn.parquet").write_bytes(cut[:-100])
    middle = bytearray(cut)
    middle[1000:9000] = bytes(8000)  # the footer is whole, the data are not
    (folder / "middle.parquet").write_bytes(middle)
    result = run_audit([folder, tmp_path / "none*.csv"], table, tmp_path / "out")
    assert result.exit_code == 0
    assert len(result.events) == 10
    assert {left["name"] for left in about(tmp_path / "out")["skipped"]["files"]} == {
        "empty.csv", "torn.parquet", "middle.parquet",
    }  # fmt: skip
    assert [p for p in result.problems if p.startswith("empty.csv: an empty file")]
    assert [p for p in result.problems if "none*.csv: no such file" in p]


def test_counts_add_up(fleet_data: pd.DataFrame, table: Path, tmp_path: Path) -> None:
    data = fleet_data.astype({"pv": object, "time": str})
    data.loc[10:14, "pv"] = "Bad Input"
    data.loc[20:22, "time"] = "never"
    data["quality"] = 192
    data.loc[30:33, "quality"] = 0
    data.loc[40:45, "quality"] = 64
    data = pd.concat([data, data.iloc[50:57]])
    text = data.to_csv(index=False) + "LIC-1,2026"
    (tmp_path / "d.csv").write_text(text)
    run_audit([tmp_path / "d.csv"], table, tmp_path / "out", AuditSettings(until="2026-03-01T00:10:00"))
    seen = about(tmp_path / "out")
    c = seen["counts"]
    assert c["rows"] == len(data) == seen["inputs"][0]["rows"]
    lost = {k: c[k] for k in ("bad_value", "bad_quality", "bad_time", "duplicate", "uncertain", "lost_lines")}
    assert lost == {
        "bad_value": 5, "bad_quality": 4, "bad_time": 3, "duplicate": 7, "uncertain": 6, "lost_lines": 1,
    }  # fmt: skip
    assert c["outside"] == 5 * 300
    assert c["rows"] == sum(
        c[k] for k in ("ok", "bad_value", "bad_quality", "bad_time", "duplicate", "late", "outside")
    )
    assert seen["text_in_values"] == {"count": 5, "most_frequent": {"Bad Input": 5}}
    assert seen["times_unreadable"] == ["never"]
    assert seen["skipped"]["lines"] == [
        {"name": "d.csv", "line": len(data) + 2, "reason": "2 cells, expected 6"}
    ]


def test_all_loops_with_defaults_where_no_table_is_given(fleet_data: pd.DataFrame, tmp_path: Path) -> None:
    fleet_data.to_parquet(tmp_path / "d.parquet")
    result = run_audit([tmp_path / "d.parquet"], None, tmp_path / "out")
    assert {r.loop for r in result.rows} == {f"LIC-{k}" for k in range(5)}
    assert about(tmp_path / "out")["settings"]["loops"] is None


def test_folder_leaves_out_loop_table_and_results(fleet_data: pd.DataFrame, tmp_path: Path) -> None:
    fleet_data.to_parquet(tmp_path / "d.parquet")
    (tmp_path / "loops.csv").write_text("name\nLIC-0\n")
    for _ in range(2):
        result = run_audit([tmp_path], tmp_path / "loops.csv", tmp_path / "out")
        assert [r.loop for r in result.rows] == ["LIC-0"]
        assert [i["name"] for i in about(tmp_path / "out")["inputs"]] == ["d.parquet"]
        assert result.problems == [f"loop LIC-{k}: not in the loop table" for k in range(1, 5)]


def test_paths_are_files_folders_and_globs(tmp_path: Path) -> None:
    for name in ("a/x.csv", "a/b/y.parquet", "a/.hidden/z.csv", "a/note.txt", "c/w.csv"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).touch()
    problems: list[str] = []
    found = expand([tmp_path / "a", tmp_path / "c" / "*.csv", tmp_path / "a" / "x.csv"], problems)
    assert list(found.values()) == ["a/b/y.parquet", "a/x.csv", "c/w.csv"]
    assert not problems


def test_name_of_ten_thousand_bytes_is_refused_by_name(fleet_data: pd.DataFrame, tmp_path: Path) -> None:
    data = pd.concat([fleet_data, fleet_data.query("loop == 'LIC-0'").assign(loop="n" * 10_000)])
    data.to_parquet(tmp_path / "d.parquet")
    result = run_audit([tmp_path / "d.parquet"], None, tmp_path / "out")
    assert len(result.rows) == 5
    assert [
        p for p in result.problems if p.startswith("loop nnn") and "at most 200 bytes" in p and len(p) < 300
    ]


# -- real and independent data ------------------------------------------------------------------------
@needs_data
def test_refinery(tmp_path: Path) -> None:
    result = run_audit([DATA / "refinery" / "data.csv"], DATA / "refinery" / "loops.csv", tmp_path)
    assert result.exit_code == 0
    assert result.counts["ok"] == result.counts["rows"] == 4506
    assert {e.loop for e in result.events} == {"LIC30501", "FIC46002", "FIC90204"}
    events = pq.read_table(tmp_path / "events.parquet")
    starts = dict(zip(events["loop"].to_pylist(), events["start"].cast("int64").to_pylist(), strict=True))
    # row 346 of 10 s samples
    data = pd.read_csv(DATA / "refinery" / "data.csv").query("loop == 'LIC30501'")
    onset = pd.Timestamp(data["time"].iloc[346], tz="UTC").value
    assert abs(starts["LIC30501"] - onset) <= 30 * 10**9


@needs_data
@pytest.mark.parametrize(
    ("folder", "file", "loops", "rows"),
    [
        ("tclab", "data.parquet", 4, 25_200),
        ("tep", "base.parquet", 13, 62_400),
        ("tep", "spsteps.parquet", 13, 104_000),
        ("quadtank", "data.parquet", 2, 4_202),
    ],
)
def test_simulated_and_laboratory_plants(
    tmp_path: Path, folder: str, file: str, loops: int, rows: int
) -> None:
    result = run_audit([DATA / folder / file], DATA / folder / "loops.csv", tmp_path)
    assert result.exit_code == 0
    assert (result.counts["loops"], result.counts["ok"]) == (loops, rows)
    assert str(pq.read_schema(tmp_path / "events.parquet").field("start").type) == "double"


def test_a_bound_before_1970_is_read_to_the_fraction() -> None:
    """Half a second before a full one is that, and not half a second after it."""
    span = AuditSettings(since="1969-12-31T23:59:58.5Z", until="9999-12-31").span()
    assert span.since == -1_500_000_000
    assert span.until is not None
    assert span.until < 2**63
