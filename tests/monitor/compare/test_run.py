"""From two folders to tables and page: the same bytes each time, hostile names harmless, one line for what is wrong."""

from __future__ import annotations

import csv
from pathlib import Path

import pyarrow.parquet as pq
import pytest

from monitor.adapters.tables import write_spells, write_tables
from monitor.compare.between import compare
from monitor.compare.run import columns_of, run_compare
from monitor.contract.records import LoopRow

from .tools import audit, events, row, spells

FORMULA = "=cmd()"


def folder(path: Path, rows: list[LoopRow], ci: float) -> Path:
    """An audit's folder, whose loops all have the same index."""
    path.mkdir()
    write_tables(path, [e for r in rows for e in events([ci] * 6, r.loop)], rows, seconds=False)
    write_spells(path, [s for r in rows for s in spells(0.1 / ci, r.loop)], seconds=False)
    (path / "audit.json").write_text('{"versions": {"loopsight": "0.1.0"}, "counts": {"events": 6}}')
    return path


def test_tables_and_page(tmp_path: Path) -> None:
    old = folder(tmp_path / "old", [row("LIC-1"), row(FORMULA)], 0.3)
    new = folder(tmp_path / "new", [row("LIC-1", kp=4.0), row(FORMULA)], 0.8)
    found, files = run_compare(old, new, tmp_path / "out")
    first = [f.read_bytes() for f in files]
    assert [f.name for f in files] == ["compare.html", "compare.csv", "compare.parquet"]
    assert found.counts["better"] == 2
    run_compare(old, new, tmp_path / "again")
    assert [(tmp_path / "again" / f.name).read_bytes() for f in files] == first
    with files[1].open(newline="") as file:
        lines = list(csv.DictReader(file))
    assert [line["loop"] for line in lines] == ["LIC-1", "'" + FORMULA]
    assert lines[0]["settings_words"] == "kp 2 → 4"
    table = pq.read_table(files[2]).to_pydict()
    assert table["loop"] == ["LIC-1", FORMULA]
    assert table["ci_setpoint_ratio"] == pytest.approx([0.8 / 0.3] * 2)
    assert table["ci_setpoint_n_before"] == [6, 6]
    assert table["ci_load_ratio"] == [None, None]
    assert (table["kp_before"][0], table["kp_after"][0]) == (2.0, 4.0)


def test_a_loop_that_one_of_the_two_has_is_a_row() -> None:
    table = columns_of(compare(audit([row("A"), row("TIC-3")]), audit([row("A"), row("X/TIC-3")])))
    assert table["loop"][1] == ["A", "X/TIC-3", "TIC-3"]
    assert table["outcome"][1] == ["cannot_tell", "new", "missing"]
    assert table["looks_renamed"][1] == ["", "TIC-3", "X/TIC-3"]
    assert table["verdict_before"][1] == ["good", "", "good"]
    assert len({len(values) for _, values in table.values()}) == 1


def test_no_loop_in_both_is_one_line_with_what_looks_renamed(tmp_path: Path) -> None:
    old, new = (folder(tmp_path / n, [row(n)], 0.5) for n in ("LIC-1", "X:LIC1"))
    with pytest.raises(ValueError, match="no loop is in both; some look renamed: LIC-1 → X:LIC1") as found:
        run_compare(old, new, tmp_path / "out")
    assert "\n" not in str(found.value)
    assert not (tmp_path / "out").exists()
