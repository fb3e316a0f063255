"""Rows 57 to 60 of the bad-data matrix: files that are damaged, hostile, or written as others write them."""

from __future__ import annotations

import gzip
import json
import resource
import subprocess
import sys
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from monitor.audit.plan import plan
from monitor.audit.run import run_audit
from monitor.audit.settings import AuditSettings
from monitor.contract.records import GOOD
from tests.bad_data.harness import NAME, SECOND, SETTINGS, Outcome, audit, both, good, same, write

N = 700


@pytest.mark.parametrize("style", ["bom", "crlf", "semicolon", "latin-1", "utf-16", "tab"])
def test_a_csv_file_as_others_write_it(clean: Outcome, tmp_path: Path, style: str) -> None:
    """Byte order mark, CRLF, semicolons with decimal commas, older encodings: the same records."""
    text = write(good(N), tmp_path / "plain.csv").read_text()
    if style == "semicolon":
        text = text.replace(",", ";").replace(".", ",")
    if style == "tab":
        text = text.replace(",", "\t")
    encoding = {"bom": "utf-8-sig", "latin-1": "latin-1", "utf-16": "utf-16"}.get(style, "utf-8")
    if style == "latin-1":
        text = text.replace("\n", ",°C\n").replace(",°C", ",einheit", 1)
    path = tmp_path / "d.csv"
    path.write_bytes(text.replace("\n", "\r\n" if style == "crlf" else "\n").encode(encoding))
    found = audit([path], tmp_path / "a")
    same(found, clean)


def test_a_torn_last_line_costs_itself(clean: Outcome, tmp_path: Path) -> None:
    """A file that was cut while it was written: the line is named, the rest is used."""
    path = write(good(N), tmp_path / "d.csv")
    path.write_text(path.read_text() + "LIC-101,2026-01-01T00:1")
    found = audit([path], tmp_path / "a")
    same(found, clean)
    assert found.about["skipped"]["lines"] == [
        {"name": "d.csv", "line": N + 2, "reason": "2 cells, expected 5"}
    ]


def test_damaged_files_beside_good_ones(clean: Outcome, tmp_path: Path) -> None:
    """Footer gone, nothing in it, no Parquet at all, a loop table: each named with its reason, the good one is used."""
    folder = tmp_path / "in"
    folder.mkdir()
    whole = write(good(N), folder / "good.parquet").read_bytes()
    (folder / "footer.parquet").write_bytes(whole[:-20])
    (folder / "empty.csv").write_bytes(b"")
    (folder / "lie.parquet").write_bytes(b"PAR1" + bytes(100) + b"PAR1")
    (folder / "zeros.csv").write_bytes(bytes(10_000))
    (folder / "wide.csv").write_text("time," + ",".join(f"c{k}" for k in range(200_000)) + "\n")
    found = audit([folder], tmp_path / "a")
    same(found, clean)
    left = {s["name"]: s["reason"] for s in found.about["skipped"]["files"]}
    assert set(left) == {"footer.parquet", "empty.csv", "lie.parquet", "zeros.csv", "wide.csv"}
    assert all(left.values())
    assert "columns, expected at most" in left["wide.csv"]


def test_nothing_usable_is_exit_2(tmp_path: Path) -> None:
    """One line for each file, and no result."""
    (tmp_path / "a.csv").write_bytes(b"\x00" * 100)
    (tmp_path / "b.parquet").write_bytes(b"PAR1")
    result = run_audit([tmp_path / "*.csv", tmp_path / "*.parquet"], None, tmp_path / "out")
    assert result.exit_code == 2
    assert len(result.problems) == 2
    assert not (tmp_path / "out").exists()


BOMB = """
import resource, sys
from pathlib import Path
from monitor.adapters.historian.reader import inspect
from monitor.adapters.historian.rows import UnusableError
resource.setrlimit(resource.RLIMIT_DATA, (1_000_000_000, 1_000_000_000))
before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
for path in map(Path, sys.argv[1:]):
    try:
        inspect(path, path.name)
    except UnusableError as error:
        print(error)
    else:
        print(path.name, "was accepted")
print((resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) // 1024)
"""


def test_files_that_are_made_to_harm(tmp_path: Path) -> None:
    """A small Parquet file of gigabytes, a CSV line without end, archives: refused before they take memory."""
    n = 12_000_000
    constant = pa.array(np.full(n, 5.0))
    name = pa.DictionaryArray.from_arrays(np.zeros(n, np.int32), pa.array(["x"]))
    table = pa.table({"loop": name, "time": constant, "sp": constant, "pv": constant, "op": constant})
    pq.write_table(table, tmp_path / "bomb.parquet", compression="zstd")
    with (tmp_path / "line.csv").open("wb") as file:
        file.truncate(2 << 30)  # sparse: two gigabytes without an end of line
    with gzip.open(tmp_path / "d.csv.gz", "wb") as packed:
        packed.write(b"loop,time,sp,pv,op\n")
    with zipfile.ZipFile(tmp_path / "d.zip", "w") as archive:
        archive.writestr("d.csv", "loop,time,sp,pv,op\n")
    files = ["bomb.parquet", "line.csv", "d.csv.gz", "d.zip"]
    done = subprocess.run(
        [sys.executable, "-c", BOMB, *(str(tmp_path / f) for f in files)],
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    *refused, grown = done.stdout.splitlines()
    assert [line.split(":")[0] for line in refused] == files
    assert not [line for line in refused if "accepted" in line]
    assert int(grown) < 150, f"{grown} MB"
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss > 0


HOSTILE = ["../../etc/x", "<script>alert(1)</script>", "=cmd()", "a/*/b", "\u202egnp.exe", "%s%n", "x" * 200]


def test_hostile_names_are_data_in_both_ways(clean: Outcome, tmp_path: Path) -> None:
    """Names with a meaning elsewhere: judged like any other, live under a key of their own, no file made of them."""
    for number, name in enumerate(HOSTILE):
        folder = tmp_path / str(number)
        found = both(good(N, name=name), folder, table=[{**SETTINGS, "name": name}], payloads=("sample",))
        assert found.row.verdict == GOOD
        assert found.event.iae == clean.event.iae
        made = {p.name for p in folder.rglob("*") if p.is_file()}
        assert made == {
            "loops.csv", "data.csv", "data.parquet", "loopsight.sqlite", "loopsight.lock",
            "loops.parquet", "events.parquet", "audit.json", "loops.xlsx", "report.html", "evidence.parquet",
            "answers.parquet",
            "spells.parquet",
        }  # fmt: skip
    assert {p.name for p in tmp_path.iterdir()} == {str(k) for k in range(len(HOSTILE))}


@pytest.mark.parametrize("name", ["n" * 10_000, "\u202eLIC\u2066", "a\nb", "\x1b[2J"])
def test_names_that_break_the_rules_are_refused_by_name(tmp_path: Path, name: str) -> None:
    """Too long: named in the report. What a terminal would obey is shown as an escape."""
    data = pd.concat([good(50), good(50, name=name)])
    data.to_parquet(tmp_path / "d.parquet")
    result = run_audit([tmp_path / "d.parquet"], None, tmp_path / "out", AuditSettings(time_unit="ns"))
    assert result.exit_code == 0
    assert NAME in {r.loop for r in result.rows}
    assert all(line.isprintable() for line in result.problems)
    if len(name) > 200:
        assert len(result.rows) == 1
        assert "at most 200 bytes" in result.problems[0]


def test_any_order_of_rows_gives_the_same_bytes(tmp_path: Path) -> None:
    """Shuffled rows, other row groups: the same tables, byte by byte."""
    data = pd.concat([good(N, name=f"L{k}", seed=k) for k in range(4)])
    table = [{**SETTINGS, "name": f"L{k}"} for k in range(4)]
    shuffled = data.sample(frac=1.0, random_state=1)
    files = ("events.parquet", "loops.parquet", "loops.csv")
    written = []
    for number, rows in enumerate((data, shuffled, data.sort_values("time", kind="stable"))):
        found = audit(rows, tmp_path / str(number), ".parquet", table)
        assert len(found.events) == 4
        out = tmp_path / str(number) / "outparquet"
        written.append([(out / f).read_bytes() for f in files])
    assert written[0] == written[1] == written[2]


@pytest.mark.slow
def test_any_workers_and_any_order_of_tasks_give_the_same_bytes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One task; two in a pool of two; eight of them, shuffled: every file is the same, byte by byte."""
    data = fleet()
    table = [{**SETTINGS, "name": f"L{k}"} for k in range(9)]
    folders = []
    for cuts, jobs, seed in ((1, 1, 0), (2, 2, 0), (8, 1, 1)):

        def shuffled(*given: Any, cuts: int = cuts, seed: int = seed) -> Any:
            tasks = plan(*given[:3], cuts)
            assert len(tasks) == cuts
            return [tasks[k] for k in np.random.default_rng(seed).permutation(cuts)]

        monkeypatch.setattr("monitor.audit.run.plan", shuffled)
        folders.append(tmp_path / f"{cuts}-{jobs}-{seed}")
        assert len(audit(data, folders[-1], ".parquet", table, jobs=jobs).events) == 9
    first, *others = map(everything, folders)
    assert first["loops.csv"].count(b"stale") == 1
    assert all(other == first for other in others)


@pytest.mark.slow
def test_eight_workers_give_the_same_bytes(tmp_path: Path) -> None:
    """A pool of eight processes, more than there are cores (15 s, most of it their starting)."""
    data = fleet()
    table = [{**SETTINGS, "name": f"L{k}"} for k in range(9)]
    written = []
    for jobs in (1, 8):
        audit(data, tmp_path / str(jobs), ".parquet", table, jobs=jobs)
        written.append(everything(tmp_path / str(jobs)))
    assert written[0] == written[1]


def everything(folder: Path) -> dict[str, bytes]:
    """All that an audit has written, but when."""
    out = folder / "outparquet"
    about = json.loads((out / "audit.json").read_text())
    assert about.pop("generated_at")
    # the inputs were written anew: their bytes are compared, not where they lie
    files = {f: (out / f).read_bytes() for f in ("events.parquet", "loops.parquet", "loops.csv")}
    return {**files, "audit.json": json.dumps(about).encode()}


def fleet() -> pd.DataFrame:
    """Nine loops with an event each; one ends two hours before the others, and is stale."""
    last = good(N, name="L8", seed=8)
    last["time"] -= 7200 * SECOND
    return pd.concat([*(good(N, name=f"L{k}", seed=k) for k in range(8)), last])
