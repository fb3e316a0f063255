"""A simulation as a historian export, with the loop table and the truth."""

import csv
import io
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq

from monitor.adapters.files import replacing, write_text
from sim_plants.loops import DEFAULT_START, LoopSpec, Simulation
from sim_plants.payloads import FRAME_SCHEMA, iso_times, name_array, to_batch
from sim_plants.truth import EVENT_COLUMNS, TRUTH_COLUMNS, loop_table, truth_events, truth_rows

# Rows held in memory and written as one row group.
_CHUNK_SAMPLES = 1_000_000


def write_export(
    loops: Sequence[LoopSpec], seconds: float, folder: Path | str, start: float = DEFAULT_START
) -> int:
    """Simulate and write `data.parquet`, `loops.csv`, `truth.csv` and `truth_events.csv`.

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

    Returns
    -------
    int
        Number of samples written.

    Raises
    ------
    OSError
        If something cannot be written.
    """
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    rows = _write_samples(Simulation(loops, start), seconds, folder / "data.parquet")
    write_rows(folder / "loops.csv", loop_table(loops))
    write_truth(loops, seconds, folder, start)
    return rows


def write_truth(loops: Sequence[LoopSpec], seconds: float, folder: Path, start: float) -> None:
    """Write `truth.csv`, `truth_events.csv` of the `seconds` [s] from `start` [s since 1970 UTC] on."""
    write_rows(folder / "truth.csv", truth_rows(loops), TRUTH_COLUMNS)
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


def _write_samples(simulation: Simulation, seconds: float, path: Path) -> int:
    """Write the samples of `seconds` [s] in long form, part by part; returns their number."""
    names = name_array([loop.name for loop in simulation.loops])
    left, chunk = seconds, _CHUNK_SAMPLES / simulation.rate
    total = 0
    with replacing(path) as file, pq.ParquetWriter(file, FRAME_SCHEMA) as writer:
        while left > 0:
            block = simulation.advance(min(chunk, left))
            writer.write_batch(to_batch(block, block.loop, names, FRAME_SCHEMA))
            total += len(block)
            left -= chunk
    return total
