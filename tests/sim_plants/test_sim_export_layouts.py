"""Exports as plants' systems write them: cut anywhere the same, and audited to the verdicts of the long form."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import pytest

from monitor.audit.run import run_audit
from sim_plants.export import LAYOUT_START, data_name, write_export, write_layout
from sim_plants.export_layouts import LAYOUTS, suffixes, text, wide
from sim_plants.scenarios import demo
from sim_plants.specs import LoopSpec
from tests.support.export_families import base

SECONDS = 1800.0


def loops() -> list[LoopSpec]:
    """A good one, one to retune, and one in manual."""
    return [loop for loop in demo(1) if loop.name in {"LIC-101", "LIC-102", "FIC-404"}]


def verdicts(path: Path, table: Path, out: Path) -> dict[str, tuple[object, ...]]:
    result = run_audit([path], table, out)
    assert result.exit_code == 0, result.problems
    events = [e.loop for e in result.events]
    return {r.loop: (r.verdict, r.flags, r.rule, events.count(r.loop)) for r in result.rows}


@pytest.fixture(scope="module")
def expected(tmp_path_factory: pytest.TempPathFactory) -> dict[str, tuple[object, ...]]:
    folder = tmp_path_factory.mktemp("plain")
    write_export(loops(), SECONDS, folder, LAYOUT_START)
    found = verdicts(folder / "data.parquet", folder / "loops.csv", folder / "out")
    assert {name: row[0] for name, row in found.items()} == {
        "LIC-101": "good",
        "LIC-102": "retune",
        "FIC-404": "not_assessed",
    }
    return found


@pytest.mark.parametrize("name", LAYOUTS)
def test_each_layout_is_audited_to_the_same_verdicts(
    expected: dict[str, tuple[object, ...]], tmp_path: Path, name: str
) -> None:
    layout = LAYOUTS[name]
    assert write_export(loops(), SECONDS, tmp_path, LAYOUT_START, layout) == 3 * SECONDS
    assert verdicts(tmp_path / data_name(layout), tmp_path / "loops.csv", tmp_path / "out") == expected


@pytest.mark.parametrize("name", [n for n in LAYOUTS if LAYOUTS[n].suffix == ".csv"])
def test_cut_anywhere_it_is_the_same_text(tmp_path: Path, name: str) -> None:
    """What comes part by part is what comes at once."""
    data = base().sort_values("time", kind="stable", ignore_index=True)
    if LAYOUTS[name].table(data).astype(str).isin(["Bad Input", "I/O Timeout", "No Data"]).any(axis=None):
        pytest.skip("which values are lost is counted by part")
    written = []
    for cuts in ((0, 180), (0, 3, 90, 180)):
        folder = tmp_path / str(len(cuts))
        folder.mkdir()
        parts = (data.iloc[a:b] for a, b in pairwise(cuts))
        assert write_layout(parts, LAYOUTS[name], folder) == 180
        written.append({p.name: p.read_text() for p in sorted(folder.rglob("*.csv"))})
    assert written[0] == written[1]


def test_an_earlier_export_is_replaced_whole(tmp_path: Path) -> None:
    """Files of loops that are no more do not stay among the others."""
    for data in (base(), base()[lambda d: d["loop"] == "TIC-7"]):
        write_layout(
            [data.assign(loop=data["loop"].cat.remove_unused_categories())],
            LAYOUTS["one-file-per-loop"],
            tmp_path,
        )
    assert [p.name for p in (tmp_path / "data").iterdir()] == ["TIC-7.csv"]


def test_files_of_somebody_else_are_left_alone(tmp_path: Path) -> None:
    """In a folder `data` that no simulation has written; its own is replaced."""
    (tmp_path / "data").mkdir()
    own = tmp_path / "data" / "LIC-1.csv"
    own.write_text("time,sp,pv,op\n")
    layout = LAYOUTS["one-file-per-loop"]
    with pytest.raises(
        ValueError, match="holds files that are no simulation's, expected an empty or a new folder"
    ):
        write_export(loops(), 60.0, tmp_path, layout=layout)
    assert own.read_text() == "time,sp,pv,op\n"
    own.unlink()
    for _ in range(2):
        assert write_export(loops(), 60.0, tmp_path, layout=layout) > 0


def test_a_sheet_takes_no_more_rows_than_it_has(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sim_plants.export.MOST_SHEET_ROWS", 59)
    with pytest.raises(ValueError, match=r"data\.xlsx: 60 rows, expected at most 59"):
        write_layout([base()], LAYOUTS["excel"], tmp_path)
    assert not list(tmp_path.iterdir())


def test_what_no_loop_has_is_empty() -> None:
    """Loops of other periods: a row for each time, an empty cell where there is no sample; fractions are told."""
    data = base(n=4, step_s=0.5)
    table = wide(data[~((data["loop"] == "LIC-42") & (data.index % 2 == 1))], suffixes(".SP", ".PV", ".OP"))
    assert table["LIC-42.PV"].notna().tolist() == [True, False, True, False]
    assert table["Timestamp"].tolist()[1] == "2026-03-14 08:30:00.500000"
    assert text("%S.%f")(data["time"])[1] == "00.500000"
