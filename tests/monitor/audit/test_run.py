"""The audit as its user meets it: files in, tables out, the same bytes whoever does the work."""

from __future__ import annotations

import csv
import json
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow.parquet as pq
import pytest
from click.testing import CliRunner, Result

from monitor.adapters.tables import columns, loops_csv, write_tables
from monitor.audit import tasks
from monitor.audit.result import PARTS
from monitor.audit.run import expand, run_audit
from monitor.audit.tasks import Part, Task, plan, run_task
from monitor.cli.audit import audit as audit_command
from monitor.contract.records import Assessment, LoopRow
from monitor.contract.text import visible
from tests.support.places import SHARED
from tests.support.plants import pi_loop

DATA = SHARED / "data"
FILES = ("events.parquet", "loops.parquet", "loops.csv", "audit.json")
START = np.datetime64("2026-03-01T00:00:00", "ns").astype(np.int64)

needs_data = pytest.mark.skipif(
    not DATA.is_dir(), reason="the shared data sets are not beside this repository"
)


def step_test(name: str, n: int = 900, seed: int = 0) -> pd.DataFrame:
    """A level under PI, 1 s samples, its set point stepped at 300 s and back at 600 s."""
    sp = np.where((np.arange(n) >= 300) & (np.arange(n) < 600), 55.0, 50.0)
    pv, op = pi_loop(sp, kp=8.0, ti=40.0, gain=0.01, dead=2, noise=0.02, seed=seed, op0=40.0)
    return pd.DataFrame({"loop": name, "time": START + 10**9 * np.arange(n), "sp": sp, "pv": pv, "op": op})


@pytest.fixture(scope="module")
def fleet_data() -> pd.DataFrame:
    parts = [step_test(f"LIC-{k}", seed=k) for k in range(5)]
    data = pd.concat(parts).sort_values(["time", "loop"], kind="stable").reset_index(drop=True)
    return data.assign(time=pd.to_datetime(data["time"], utc=True))


@pytest.fixture
def table(tmp_path: Path) -> Path:
    path = tmp_path / "table.csv"
    path.write_text("name,kp,ti\n" + "".join(f"LIC-{k},8,40\n" for k in range(5)))
    return path


def content(out: Path) -> dict[str, bytes]:
    """All files of an audit, the time of its making left out."""
    found = {f: (out / f).read_bytes() for f in FILES}
    about = json.loads(found["audit.json"])
    assert about.pop("generated_at").endswith("Z")
    return {**found, "audit.json": json.dumps(about).encode()}


def command(*args: object) -> Result:
    return CliRunner().invoke(audit_command, [str(a) for a in args])


def about(out: Path) -> dict[str, Any]:
    return dict(json.loads((out / "audit.json").read_text()))


# -- the same bytes ---------------------------------------------------------------------------------


def test_jobs_change_nothing(fleet_data: pd.DataFrame, table: Path, tmp_path: Path) -> None:
    fleet_data.sort_values(["loop", "time"]).to_parquet(tmp_path / "d.parquet", row_group_size=500)
    found = []
    for jobs in (1, 2):
        result = run_audit([tmp_path / "d.parquet"], table, tmp_path / f"o{jobs}", jobs=jobs)
        assert result.exit_code == 0
        assert len(result.events) == 10
        found.append(content(tmp_path / f"o{jobs}"))
    assert found[0] == found[1]
    assert not (tmp_path / "o2" / PARTS).exists()


@pytest.mark.parametrize("n", [2, 3, 5])
def test_any_cut_into_tasks_gives_the_same(
    fleet_data: pd.DataFrame, table: Path, tmp_path: Path, n: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Files of every layout together, some loops in none, unknown ones too; tasks one after the other."""
    folder = tmp_path / "in"
    folder.mkdir()
    long = fleet_data.query("loop in ['LIC-0', 'LIC-1']")
    long.sort_values(["loop", "time"]).to_parquet(folder / "long.parquet", row_group_size=300)
    fleet_data.query("loop == 'LIC-2'").drop(columns="loop").to_csv(folder / "LIC-2.csv", index=False)
    wide = fleet_data.query("loop == 'LIC-3'").drop(columns="loop")
    wide = wide.rename(columns={c: f"LIC-3.{c}" for c in ("sp", "pv", "op")}).assign(**{"X.pv": "no"})
    wide.to_csv(folder / "wide.csv", index=False)
    fleet_data.query("loop == 'LIC-4'").assign(loop="other").to_csv(folder / "zz.csv", index=False)
    run_audit([folder], table, tmp_path / "one")
    one = content(tmp_path / "one")
    seen = about(tmp_path / "one")
    assert {s["loop"] for s in seen["skipped"]["loops"]} == {"X", "other"}
    assert seen["loops_without_data"] == ["LIC-4"]
    monkeypatch.setattr(
        "monitor.audit.run.plan", lambda loops, sources, span, _: plan(loops, sources, span, n)
    )
    run_audit([folder], table, tmp_path / "many")
    assert content(tmp_path / "many") == one


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


def test_resume_takes_over_what_is_done(
    fleet_data: pd.DataFrame, table: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    fleet_data.to_parquet(tmp_path / "d.parquet")
    run_audit([tmp_path / "d.parquet"], table, tmp_path / "whole")
    monkeypatch.setattr(
        "monitor.audit.run.plan", lambda loops, sources, span, _: plan(loops, sources, span, 3)
    )
    done: list[Task] = []

    def stops(task: Task, progress: Any) -> Part:
        if len(done) == 2:
            raise KeyboardInterrupt
        done.append(task)
        return run_task(task, progress)

    monkeypatch.setattr(tasks, "run_task", stops)
    with pytest.raises(KeyboardInterrupt):
        run_audit([tmp_path / "d.parquet"], table, tmp_path / "out")
    assert len(list((tmp_path / "out" / PARTS).iterdir())) == 2
    torn = min((tmp_path / "out" / PARTS).iterdir())
    torn.write_bytes(torn.read_bytes()[:-5])  # torn: done again
    again: list[Task] = []
    monkeypatch.setattr(
        tasks, "run_task", lambda task, progress: (again.append(task), run_task(task, progress))[1]
    )
    run_audit([tmp_path / "d.parquet"], table, tmp_path / "out", resume=True)
    assert len(again) == 2
    assert content(tmp_path / "out") == content(tmp_path / "whole")
    # without --resume nothing is taken over
    done.clear()
    monkeypatch.setattr(tasks, "run_task", stops)
    with pytest.raises(KeyboardInterrupt):
        run_audit([tmp_path / "d.parquet"], table, tmp_path / "out")
    done.clear()
    with pytest.raises(KeyboardInterrupt):
        run_audit([tmp_path / "d.parquet"], table, tmp_path / "out")
    assert len(done) == 2
    # other settings, other parts
    assert len({t.identity(v) for t in again for v in ("1", "2")}) == 4


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
    run_audit([tmp_path / "d.csv"], table, tmp_path / "out", until="2026-03-01T00:10:00")
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


@pytest.mark.parametrize(
    ("files", "args", "says"),
    [
        ({}, ["none.csv"], "none.csv: no such file"),
        ({"d.csv": "a,b\n1,2\n"}, ["d.csv"], "d.csv: columns a, b, expected"),
        ({"d.csv": "loop,time,sp,pv,op\nX,1,2,3,4\n"}, ["d.csv", "--loops", "t.csv"], "no loop of the table"),
        ({"d.csv": "loop,time,sp,pv,op\nX,1,a,b,c\n"}, ["d.csv"], "no good sample in 1 rows: 1 bad_value"),
        ({"d.csv": "loop,time,sp,pv,op\nX,1,2,3,4\n"}, ["d.csv", "--loops", "n.csv"], "n.csv: No such file"),
        ({"d.csv": "loop,time,sp,pv,op\nX,1,2,3,4\n"}, ["d.csv", "--tz", "Mars"], "--tz: 'Mars', expected"),
        (
            {"d.csv": "loop,time,sp,pv,op\nX,1,2,3,4\n"},
            ["d.csv", "--since", "noon"],
            "--since: 'noon', expected",
        ),
        ({"d.csv": "loop,time,sp,pv,op\nX,45000,2,3,4\n"}, ["d.csv"], "--time-unit"),
    ],
)
def test_nothing_usable_is_exit_2_and_one_line_each(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, files: dict[str, str], args: list[str], says: str
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "t.csv").write_text("name\nLIC-1\n")
    for name, text in files.items():
        (tmp_path / name).write_text(text)
    result = command(*args, "--out", "out")
    assert result.exit_code == 2
    assert says in result.stderr
    assert "Traceback" not in result.output
    assert not result.stdout
    assert not list((tmp_path / "out").glob("*"))


@pytest.mark.skipif(find_spec("distributed") is not None, reason="dask.distributed is installed here")
def test_scheduler_without_its_library_names_the_extra(table: Path, tmp_path: Path) -> None:
    step_test("LIC-1").to_csv(tmp_path / "d.csv", index=False)
    result = command(
        tmp_path / "d.csv", "--loops", table, "--out", tmp_path / "out", "--scheduler", "tcp://x:1"
    )
    assert result.exit_code == 2
    assert result.stderr.count("\n") == 1
    assert "loopsight[cluster]" in result.stderr


def test_bad_loop_table_names_each_problem(tmp_path: Path) -> None:
    (tmp_path / "t.csv").write_text("name,ti\nA,-1\nA,2\nB,x\n")
    result = command(tmp_path / "t.csv", "--loops", tmp_path / "t.csv", "--out", tmp_path / "out")
    assert result.exit_code == 2
    assert len(result.stderr.splitlines()) == 2
    assert "t.csv:2: ti: '-1', expected seconds above 0" in result.stderr


# -- command ----------------------------------------------------------------------------------------


def test_command_shows_the_worst_first_and_where_the_files_are(
    fleet_data: pd.DataFrame, table: Path, tmp_path: Path
) -> None:
    fleet_data.to_parquet(tmp_path / "d.parquet")
    result = command(tmp_path / "d.parquet", "--loops", table, "--out", tmp_path / "out")
    assert result.exit_code == 0
    assert result.stderr == ""
    lines = result.stdout.splitlines()
    assert lines[0].split() == ["verdict", "loop", "CI", "Ms", "why", "new", "settings"]
    assert "5 loops, 10 events, 4500 of 4500 samples used" in lines[-2]
    assert lines[-1].endswith("out/: loops.csv, loops.parquet, events.parquet, audit.json")
    assert max(map(len, lines)) <= 140


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


def test_help_and_import_are_light() -> None:
    heavy = {"numpy", "pyarrow", "numba", "rich"}
    code = f"import sys, monitor.audit, monitor.check; print(len({heavy} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "0"
    assert "Example:\n    loopsight audit " in command("--help").stdout


# -- tables -----------------------------------------------------------------------------------------


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
    "name", ["../../etc/x", "<script>", "=cmd()", "a/*/b", "\u202egnp.exe", "[bold]x", "a\x1b[2Jb"]
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
