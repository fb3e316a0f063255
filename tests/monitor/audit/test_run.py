"""The audit as its user meets it: files in, tables out, the same bytes whoever does the work."""

from __future__ import annotations

import json
from pathlib import Path

import pandas as pd
import pyarrow.parquet as pq
import pytest

from monitor.audit.run import run_audit
from sim_plants.export import write_export
from sim_plants.scenarios import SCENARIOS
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


# -- a published case -----------------------------------------------------------------------------
def test_the_pumped_tanks_test_gives_the_settings_of_its_paper(tmp_path: Path) -> None:
    """Rice & Cooper (2002), imc-pid: -22.9 %/m, 8.0 and 0.51 min, from P-only control with steps of the set point."""
    write_export(SCENARIOS["pumped-tank-test"](1), 3 * 3600.0, tmp_path)
    pd.read_csv(tmp_path / "loops.csv").assign(controller="pid", rule="imc-pid").to_csv(
        tmp_path / "loops.csv", index=False
    )
    assert run_audit([tmp_path / "data.parquet"], tmp_path / "loops.csv", tmp_path / "out").exit_code == 0
    row = pd.read_csv(tmp_path / "out" / "loops.csv").iloc[0]
    assert (row.rule, row.form) == ("imc-pid", "standard")
    aim = json.loads(row.stages)[-1]
    # kp goes with 1/theta, which the noise leaves uncertain by a few per cent
    assert (aim["kp"], aim["ti"] / 60, aim["td"] / 60) == pytest.approx((-22.9, 8.0, 0.51), rel=0.08)


# -- real and independent data ------------------------------------------------------------------------
@needs_data
def test_refinery(tmp_path: Path) -> None:
    result = run_audit([DATA / "refinery" / "data.csv"], DATA / "refinery" / "loops.csv", tmp_path)
    assert result.exit_code == 0
    assert result.counts["ok"] == result.counts["rows"] == 4506
    assert {e.loop for e in result.events} == {
        "LIC30501",
        "FIC46002",
        "FIC90204",
        "FIC40102B",
    }  # the last a slave
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
