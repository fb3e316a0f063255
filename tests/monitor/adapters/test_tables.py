"""Tables of records: columns, types, times, hostile names."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from monitor.adapters.tables import columns, loops_csv, write_tables
from monitor.contract.records import Assessment, LoopRow
from monitor.contract.text import visible
from tests.monitor.audit.tools import FILES, START, command, step_test


def test_tables_have_the_records_columns_and_types(tmp_path: Path) -> None:
    event = Assessment(
        loop="=cmd()", id="1", event=1, kind="setpoint", start=START, end=START + 10**9, state="settled",
        amplitude=1.0, verdict="good", reason="",
    )  # fmt: skip
    row = LoopRow(loop="=cmd()", new_ti=float("inf"), ci_setpoint=float("nan"), flags=("manual", "idle"))
    write_tables(tmp_path, [event], [row], seconds=False)
    events, loops = (pq.read_table(tmp_path / f) for f in ("events.parquet", "loops.parquet"))
    assert events.column_names == list(Assessment.__struct_fields__)
    assert loops.column_names == list(LoopRow.__struct_fields__)
    types = {name: str(t) for name, t in zip(events.schema.names, events.schema.types, strict=True)}
    assert types["start"] == types["end"] == "timestamp[ns, tz=UTC]"
    assert {types[k] for k in ("iae", "gain_lo", "fit")} == {"double"}
    assert types["event"] == "int64"
    assert types["reason"] == "string"
    got = loops.to_pylist()[0]
    assert got["loop"] == "=cmd()"
    assert got["new_ti"] == np.inf
    assert got["ci_setpoint"] is None
    assert got["flags"] == ["manual", "idle"]
    (cells,) = csv.DictReader((tmp_path / "loops.csv").read_text().splitlines())
    assert (cells["loop"], cells["new_ti"], cells["ci_setpoint"], cells["flags"]) == (
        "'=cmd()",
        "inf",
        "",
        "manual;idle",
    )
    assert b"pandas" not in (tmp_path / "loops.parquet").read_bytes()


def test_times_are_seconds_where_the_inputs_were() -> None:
    event = Assessment(
        loop="x", id="1", event=1, kind="load", start=36 * 10**9, end=10**8, state="settled", amplitude=1.0,
        verdict="good", reason="",
    )  # fmt: skip
    table = columns(Assessment, [event], seconds=True)
    assert table["start"] == ("float", [36.0])
    assert table["end"] == ("float", [0.1])


def test_no_rows_still_make_tables(tmp_path: Path) -> None:
    write_tables(tmp_path, [], [], seconds=True)
    assert pq.read_table(tmp_path / "events.parquet").num_rows == 0
    assert loops_csv([]).count("\n") == 1


@pytest.mark.parametrize(
    "name", ["../../etc/x", "<script>", "=cmd()", "a/*/b", "\u202egnp.exe", "[bold]x", "a\x1b[2Jb", "a\x07b"]
)
def test_hostile_names_pass_as_data(tmp_path: Path, name: str) -> None:
    data = step_test(name).assign(time=lambda d: d["time"] / 1e9)
    (tmp_path / "in").mkdir()
    data.to_parquet(tmp_path / "in" / "d.parquet")
    before = sorted(p for p in tmp_path.rglob("*"))
    result = command(tmp_path / "in", "--out", tmp_path / "out")
    assert result.exit_code == 0
    assert visible(name) in result.stdout
    assert visible(name).isprintable()
    assert pq.read_table(tmp_path / "out" / "loops.parquet")["loop"].to_pylist() == [name]
    assert sorted(set(tmp_path.rglob("*")) - set(before)) == sorted(
        [tmp_path / "out", *(tmp_path / "out" / f for f in FILES)]
    )
