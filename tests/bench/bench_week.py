"""Audit of a fleet's week: `python -m tests.bench.bench_week --loops 1000 --days 7 --jobs 2`.

A set-point step a loop and day, 1 s samples, a file a day in order of time, as a historian writes it. Prints rows/s,
the floor (reading the same columns, and nothing else), and the peak memory of all processes together.

With ``--tall N``: one CSV file of about N rows with one value each (tag, time, value), in order of time; its floor is
reading it as text.
"""

from __future__ import annotations

import argparse
import itertools
import resource
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from pyarrow import csv

START = 1_767_225_600 * 10**9
DAY_S, RESPONSE_S, PIECE_S = 86_400, 3600, 600
KP, TI, GAIN, DEAD_S = 2.0, 300.0, 0.002, 10
"""A PI level loop, well enough tuned: gain [PV/(OP s)], the rest as on its faceplate."""
NOISE = 0.05
"""[PV]"""


def response() -> tuple[np.ndarray, np.ndarray]:
    """Return PV and OP after a unit step of the set point, second by second."""
    pv, op = np.zeros(RESPONSE_S), np.zeros(RESPONSE_S)
    integral = 0.0
    for k in range(1, RESPONSE_S):
        pv[k] = pv[k - 1] + GAIN * (op[k - 1 - DEAD_S] if k > DEAD_S else 0.0)
        error = 1.0 - pv[k]
        integral += KP / TI * error
        op[k] = KP * error + integral
    return pv, op


def pieces_of(loops: int, day: int) -> Iterator[tuple[np.ndarray, list[np.ndarray]]]:
    """Yield a day of all loops, each with its own step: seconds (n,) [ns]; SP, PV and OP, each (n, loops)."""
    rng = np.random.default_rng(day)
    at, size = rng.integers(PIECE_S, DAY_S - RESPONSE_S, loops), rng.choice([-5.0, 5.0], loops)
    pv_of, op_of = (np.concatenate([[0.0], r]) for r in response())
    for first in range(0, DAY_S, PIECE_S):
        since = np.clip(np.arange(first, first + PIECE_S)[:, None] - at + 1, 0, RESPONSE_S)
        noise = rng.normal(0.0, NOISE, since.shape)
        when = START + 10**9 * (day * DAY_S + np.arange(first, first + PIECE_S, dtype=np.int64))
        pv, op = 50.0 + size * pv_of[since] + noise, 40.0 + size * op_of[since] - KP * noise
        yield when, [50.0 + size * (since > 0), pv, op]


def write_day(path: Path, loops: int, day: int) -> None:
    """Write one day of all loops."""
    names = pa.array([f"LIC-{k:04d}" for k in range(loops)])
    writer = None
    for when, values in pieces_of(loops, day):
        columns = {
            "loop": pa.DictionaryArray.from_arrays(np.tile(np.arange(loops, dtype=np.int32), PIECE_S), names),
            "time": pa.array(np.repeat(when, loops), pa.timestamp("ns", "UTC")),
            **dict(zip(("sp", "pv", "op"), (v.ravel() for v in values), strict=True)),
        }
        table = pa.table(columns)
        writer = writer or pq.ParquetWriter(path, table.schema)
        writer.write_table(table)
    assert writer is not None
    writer.close()


def write_tall(path: Path, loops: int, rows: int) -> None:
    """Write a row for each value of each second, until there are so many."""
    names = pa.array([f"LIC-{k:04d}.{role}" for k in range(loops) for role in ("SP", "PV", "OP")])
    writer, written = None, 0
    for day in itertools.count():
        for when, values in pieces_of(loops, day):
            numbers = np.stack(values, axis=2).reshape(PIECE_S, -1)
            codes = np.tile(np.arange(len(names), dtype=np.int32), PIECE_S)
            table = pa.table({
                "tag": pa.DictionaryArray.from_arrays(codes, names).cast(pa.string()),
                "time": pa.array(np.repeat(when, len(names)), pa.timestamp("ns", "UTC")).cast(pa.timestamp("s", "UTC")),
                "value": numbers.round(3).ravel(),
            })  # fmt: skip
            writer = writer or csv.CSVWriter(path, table.schema)
            writer.write_table(table)
            written += len(table)
            if written >= rows:
                writer.close()
                return


def peak_of(process: subprocess.Popen[bytes]) -> int:
    """Return the most memory that a process and its children had together [bytes] (Linux)."""
    most = 0

    def resident(pid: int) -> int:
        try:
            own = Path(f"/proc/{pid}/smaps_rollup").read_text()
            children = Path(f"/proc/{pid}/task/{pid}/children").read_text().split()
        except OSError:
            return 0
        kilobytes = next(int(line.split()[1]) for line in own.splitlines() if line.startswith("Pss:"))
        return 1024 * kilobytes + sum(resident(int(child)) for child in children)

    ended = threading.Event()
    threading.Thread(target=lambda: (process.wait(), ended.set()), daemon=True).start()
    while not ended.wait(0.5):
        most = max(most, resident(process.pid))
    return most


def read(file: Path) -> int:
    """Read a file's columns, and nothing else; return its rows."""
    if file.suffix == ".csv":
        return sum(len(batch) for batch in csv.open_csv(file))
    opened = pq.ParquetFile(file)
    for batch in opened.iter_batches(1 << 20):
        for name in ("time", "sp", "pv", "op"):
            batch.column(name).to_numpy(zero_copy_only=False)
    return opened.metadata.num_rows


def main() -> None:
    """Write, read, audit, print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--loops", type=int, default=100)
    parser.add_argument("--days", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument(
        "--tall", type=int, default=0, metavar="N", help="one CSV of single values, of N rows"
    )
    parser.add_argument("--folder", type=Path, help="keep the data here, and use what is here")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as scratch:
        folder = options.folder or Path(scratch)
        data = folder / "week"
        data.mkdir(parents=True, exist_ok=True)
        if options.tall and not (data / "tall.csv").exists():
            write_tall(data / "tall.csv", options.loops, options.tall)
        for day in range(0 if options.tall else options.days):
            path = data / f"day{day}.parquet"
            if not path.exists():
                write_day(path, options.loops, day)
        began = time.perf_counter()
        rows = sum(read(file) for file in sorted(data.iterdir()))
        floor = time.perf_counter() - began
        line = [sys.executable, "-m", "monitor", "audit", str(data), "--out", str(folder / "audit")]
        began = time.perf_counter()
        audit = subprocess.Popen(
            [*line, "--jobs", str(options.jobs)], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
        )
        peak = peak_of(audit)
        took = time.perf_counter() - began
        spent = resource.getrusage(resource.RUSAGE_CHILDREN)
        events = pq.ParquetFile(folder / "audit" / "events.parquet").metadata.num_rows
    cost = 1e6 * (spent.ru_utime + spent.ru_stime) / rows
    print(f"{rows:,} rows of {options.loops} loops, {events} events, {options.jobs} jobs: {took:.0f} s,")
    print(f"{rows / took / 1e6:.2f} M rows/s, {took / floor:.1f} times reading ({floor:.0f} s),")
    print(f"{cost:.2f} us of CPU a row, peak {peak / 1e9:.2f} GB")


if __name__ == "__main__":
    main()
