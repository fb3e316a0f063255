"""Audit of quiet long Parquet, beside merely reading the same columns into NumPy: `python -m tests.bench.bench_audit`.

Prints rows/s of both and their ratio (goal: at most 3), for files sorted by loop and by time. Start-up
(imports, compiling, processes) is measured by a tiny audit and subtracted.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from monitor.adapters.historian.merge import Span, in_order
from monitor.adapters.historian.reader import inspect
from monitor.adapters.historian.rows import Tally
from monitor.audit.run import run_audit
from monitor.audit.settings import AuditSettings
from monitor.contract.loops import Loop, LoopTable
from monitor.engine import Engine

COLUMNS = ["loop", "time", "sp", "pv", "op"]
START = 1_767_225_600 * 10**9


def quiet(path: Path, loops: int, rows: int, by: str) -> Path:
    """Write loops that lie still at their set points, 1 s samples."""
    rng = np.random.default_rng(1)
    n = loops * rows
    steps = START + 10**9 * np.arange(rows, dtype=np.int64)
    codes = np.arange(loops, dtype=np.int32)
    loop = np.repeat(codes, rows) if by == "loop" else np.tile(codes, rows)
    when = np.tile(steps, loops) if by == "loop" else np.repeat(steps, loops)
    names = pa.array([f"LIC-{k:04d}" for k in range(loops)])
    table = pa.table(
        {
            "loop": pa.DictionaryArray.from_arrays(loop, names).cast(pa.string()),
            "time": pa.array(when, pa.timestamp("ns", "UTC")),
            "sp": np.full(n, 50.0),
            "pv": 50 + rng.normal(0, 0.1, n),
            "op": 40 + rng.normal(0, 0.1, n),
        }
    )
    pq.write_table(table, path)
    return path


def floor(path: Path, threads: bool) -> None:
    """Read the columns into NumPy, and do nothing."""
    table = pq.read_table(path, columns=COLUMNS, read_dictionary=["loop"], use_threads=threads)
    for name in COLUMNS[1:]:
        table[name].to_numpy()
    for chunk in table["loop"].chunks:
        chunk.indices.to_numpy()


def best(work: Callable[[], object], times: int = 3) -> float:
    """Return the shortest of some runs [s]."""
    out = []
    for _ in range(times):
        began = time.perf_counter()
        work()
        out.append(time.perf_counter() - began)
    return min(out)


def engine(path: Path, names: list[str]) -> float:
    """Return what detection alone takes, the samples being in memory [s]."""
    wanted = {name: k for k, name in enumerate(names)}
    samples = list(in_order([inspect(path)], wanted, Span(), Tally()))

    def work() -> None:
        own = Engine(LoopTable(Loop(name=name) for name in names))
        for batch in samples:
            own.step(batch)

    return best(work)


def measure(path: Path, table: Path, jobs: list[int], warm: Path) -> None:
    """Print one file's figures."""
    names = table.read_text().split()[1:]
    n = pq.read_metadata(path).num_rows / 1e6
    floors = {
        what: best(lambda t=t: floor(path, t)) for what, t in (("one core", False), ("all cores", True))
    }
    for what, least in floors.items():
        print(f"  reading, {what:9}        {n / least:6.1f} M rows/s")
    print(f"  detection, in memory      {n / engine(path, names):6.1f} M rows/s")
    out = path.with_suffix(".out")
    for j in jobs:
        start_up = best(lambda j=j: run_audit([warm], None, out, AuditSettings(jobs=j)))
        seconds = best(lambda j=j: run_audit([path], table, out, AuditSettings(jobs=j))) - start_up
        ratios = ", ".join(f"{seconds / least:.2f} x reading on {what}" for what, least in floors.items())
        print(
            f"  audit --jobs {j}            {n / seconds:6.1f} M rows/s: {ratios} (start-up {start_up:.2f} s)"
        )


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--loops", type=int, default=200)
    parser.add_argument("--rows", type=int, default=50_000, help="per loop")
    parser.add_argument("--jobs", type=int, nargs="+", default=[1])
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder)
        warm = quiet(out / "warm.parquet", 4, 1000, "loop")
        table = out / "loops.csv"
        table.write_text("name\n" + "".join(f"LIC-{k:04d}\n" for k in range(given.loops)))
        for by in ("loop", "time"):
            print(f"{given.loops} loops x {given.rows} rows, quiet, long Parquet in the order of {by}")
            measure(quiet(out / f"{by}.parquet", given.loops, given.rows, by), table, given.jobs, warm)


if __name__ == "__main__":
    main()
