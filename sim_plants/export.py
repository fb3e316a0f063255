"""A simulation as a historian export, with the loop table and the truth."""

import csv
import io
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import chain
from pathlib import Path
from typing import Any
from urllib.parse import quote

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq

from monitor.adapters.files import replacing, write_text
from sim_plants.export_layouts import Layout
from sim_plants.loops import DEFAULT_START, LoopSpec, Simulation
from sim_plants.payloads import FRAME_SCHEMA, iso_times, name_array, to_batch
from sim_plants.truth import EVENT_COLUMNS, TRUTH_COLUMNS, loop_table, truth_events, truth_rows

LAYOUT_START = DEFAULT_START + 12 * 86_400.0
"""2026-01-13 00:00 UTC [s since 1970]: a day above 12, so that dates of every layout have one reading."""
TRUTH_FILE = "truth.csv"
# Rows held in memory and written as one row group.
_CHUNK_SAMPLES = 1_000_000
# Rows of a sheet, its headings left out.
MOST_SHEET_ROWS = 2**20 - 1


def write_export(
    loops: Sequence[LoopSpec],
    seconds: float,
    folder: Path | str,
    start: float = DEFAULT_START,
    layout: Layout | None = None,
) -> int:
    """Simulate and write `data.parquet`, `loops.csv`, `truth.csv` and `truth_events.csv`.

    With a layout, the samples are in `data` and its suffix, or in files in the folder `data`.

    Parameters
    ----------
    loops : sequence of LoopSpec
        The loops.
    seconds : float
        How long [s].
    folder : Path
        Where to; made if it is not there.
    start : float
        Time of the first sample [s since 1970 UTC].
    layout : Layout
        How a plant's system would write the samples; None: the long form, as Parquet.

    Returns
    -------
    int
        Number of samples written.

    Raises
    ------
    OSError
        If something cannot be written.
    ValueError
        More rows than the layout's kind of file takes; or files of somebody else where the samples are to be.
    """
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    if layout is not None and layout.split:
        _check_ours(folder, folder / data_name(layout))
    batches = _samples(Simulation(loops, start), seconds)
    if layout is None:
        rows = _write_parquet(batches, folder / "data.parquet")
    else:
        rows = write_layout((b.to_pandas() for b in batches), layout, folder)
    write_rows(folder / "loops.csv", loop_table(loops))
    write_truth(loops, seconds, folder, start)
    return rows


def _check_ours(folder: Path, data: Path) -> None:
    """Refuse a folder of data with files in it that stands beside no truth: no simulation has written it."""
    if data.is_dir() and any(data.iterdir()) and not (folder / TRUTH_FILE).is_file():
        raise ValueError(f"{data}: holds files that are no simulation's, expected an empty or a new folder")


def data_name(layout: Layout | None) -> str:
    """Return what the samples are called within their folder: a file, or a folder of files."""
    if layout is None:
        return "data.parquet"
    return "data/" if layout.split else f"data{layout.suffix}"


def write_truth(loops: Sequence[LoopSpec], seconds: float, folder: Path, start: float) -> None:
    """Write `truth.csv`, `truth_events.csv` of the `seconds` [s] from `start` [s since 1970 UTC] on."""
    write_rows(folder / TRUTH_FILE, truth_rows(loops), TRUTH_COLUMNS)
    events = truth_events(loops, seconds, start)
    # The onsets as text, like the times in the data: whole microseconds.
    onsets = iso_times(np.array([round(event["onset"] * 1e6) for event in events], np.int64) * 1000)
    rows = [event | {"onset": onset} for event, onset in zip(events, onsets, strict=True)]
    write_rows(folder / "truth_events.csv", rows, EVENT_COLUMNS)


def write_rows(path: Path, rows: Iterable[Mapping[str, Any]], columns: Sequence[str] = ()) -> None:
    """Write rows as CSV; None as an empty cell, true and false in lower case.

    The header is `columns`, or the keys of the first row.
    """
    rows = list(rows)
    text = io.StringIO()
    writer = csv.DictWriter(text, columns or list(rows[0]), lineterminator="\n")
    writer.writeheader()
    for row in rows:
        writer.writerow({k: str(v).lower() if isinstance(v, bool) else v for k, v in row.items()})
    write_text(path, text.getvalue())


def write_layout(samples: Iterable[pd.DataFrame], layout: Layout, folder: Path) -> int:
    """Write samples, as `export_layouts` takes them and part by part, as a system lays them out.

    Returns
    -------
    int
        Their number.

    Raises
    ------
    OSError
        If something cannot be written.
    ValueError
        More rows than a sheet takes.
    """
    parts = _Counted(samples)
    tables = (layout.table(part.reset_index(drop=True)) for part in parts)
    path = folder / data_name(layout)
    if layout.suffix == ".parquet":
        _write_parquet((pa.RecordBatch.from_pandas(table, preserve_index=False) for table in tables), path)
    elif layout.suffix == ".xlsx":
        _write_sheet(pd.concat(tables), path)
    elif layout.split:
        _write_files(tables, layout, path)
    else:
        _write_csv(tables, layout, path)
    return parts.rows


class _Counted:
    """Parts as they come, and the number of their rows."""

    def __init__(self, parts: Iterable[pd.DataFrame]) -> None:
        self._parts, self.rows = parts, 0

    def __iter__(self) -> Iterator[pd.DataFrame]:
        for part in self._parts:
            self.rows += len(part)
            yield part


def _write_csv(tables: Iterable[pd.DataFrame], layout: Layout, path: Path) -> None:
    how: dict[str, Any] = {"encoding": "utf-8", **layout.csv}
    with replacing(path) as file:
        file.write(layout.above.encode(how["encoding"]))
        for n, table in enumerate(tables):
            table.to_csv(file, index=False, header=n == 0, **how)


def _write_files(tables: Iterable[pd.DataFrame], layout: Layout, folder: Path) -> None:
    """Write each value's rows into a file that it names; files of an earlier export in that folder are removed."""
    folder.mkdir(exist_ok=True)
    for file in folder.glob(f"*{layout.suffix}"):
        file.unlink()
    for table in tables:
        for name, rows in table.groupby(layout.split, sort=False, observed=True):
            path = folder / f"{quote(str(name), safe=' ')}{layout.suffix}"
            rows.drop(columns=layout.split).to_csv(path, mode="a", index=False, header=not path.exists())


def _write_sheet(table: pd.DataFrame, path: Path) -> None:
    if len(table) > MOST_SHEET_ROWS:
        raise ValueError(
            f"{path}: {len(table)} rows, expected at most {MOST_SHEET_ROWS}: a sheet takes no more"
        )
    texts = {"options": {"strings_to_formulas": False, "strings_to_urls": False}}
    with replacing(path) as file, pd.ExcelWriter(file, engine="xlsxwriter", engine_kwargs=texts) as book:
        table.to_excel(book, index=False)


def _samples(simulation: Simulation, seconds: float) -> Iterator[pa.RecordBatch]:
    """Yield the samples of `seconds` [s] in long form, part by part."""
    names = name_array([loop.name for loop in simulation.loops])
    left, chunk = seconds, _CHUNK_SAMPLES / simulation.rate
    while left > 0:
        block = simulation.advance(min(chunk, left))
        yield to_batch(block, block.loop, names, FRAME_SCHEMA)
        left -= chunk


def _write_parquet(batches: Iterator[pa.RecordBatch], path: Path) -> int:
    """Write batches, a row group each; returns the number of rows."""
    first = next(batches)
    total = 0
    with replacing(path) as file, pq.ParquetWriter(file, first.schema) as writer:
        for batch in chain([first], batches):
            writer.write_batch(batch)
            total += len(batch)
    return total
