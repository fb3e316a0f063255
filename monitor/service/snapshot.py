"""Open events outlive a kill: the numeric state of their loops, written every few seconds, read at the next start.

Only loops with an open event are kept: all others begin anew after a restart as after any gap. The samples between
the last writing and the first sample afterwards are such a gap too: what it does to the event, the detector decides,
as for any gap. Plain arrays, no code: a file of other layouts is left alone.
"""

from __future__ import annotations

import io
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from monitor.adapters.files import write_bytes
from monitor.contract.records import event_id
from monitor.engine import Engine

from .journal import note
from .reorder import HELD_ENTRIES, Reorder

FILE_VERSION = 2
"""Of the file: goes up where the numbers mean something else than before."""
KEPT_LOOPS = 500
"""About 50 kB each: in an upset of the whole plant the first ones."""


class OpenEvents:
    """The file of open events; without a path it keeps nothing.

    Parameters
    ----------
    path
        ``open.npz`` in the state folder.
    """

    def __init__(self, path: Path | None) -> None:
        self.path = path
        self._any = True

    def keep(self, engine: Engine, reorder: Reorder, now: int) -> None:
        """Write the state of loops with an open event, once more when there is none left; ``now`` [ns since 1970]."""
        any_open = len(engine.open_rows()) > 0
        if self.path is None or not (any_open or self._any):
            return
        try:
            write(self.path, take(engine, reorder, now))
        except OSError as error:
            note("snapshot_failing", path=self.path, why=error)  # that the disk fails is said by the store
            return
        self._any = any_open

    def take_up(
        self,
        engine: Engine,
        reorder: Reorder,
        row_of: Callable[[str, str], int],
        is_over: Callable[[str], bool],
        now: int,
        arrival: float,
    ) -> set[str]:
        """Go on with the events that were open; return their ids.

        Parameters
        ----------
        row_of
            A loop's row in the table by name and key, -1 where it is not watched any more.
        is_over
            Whether the event of an id has closed since the snapshot: it is not opened again.
        now
            [ns since 1970]
        arrival
            Monotonic time [s].
        """
        found = None if self.path is None else read(self.path)
        if found is None or not len(found.names):
            return set()
        rows = np.array(
            [row_of(str(n), str(k)) for n, k in zip(found.names, found.keys, strict=True)], np.int64
        )
        engine.follow()
        reorder.grow(len(engine.loops))
        if not fits(found, engine, reorder):
            note("snapshot_version")
            return set()
        onsets = found.arrays["onset"]
        ids = [event_id(str(n), int(onset)) for n, onset in zip(found.names, onsets, strict=True)]
        rows[[is_over(identity) for identity in ids]] = -1
        put_back(found, rows, engine, reorder, arrival)
        going_on = {identity for identity, row in zip(ids, rows, strict=True) if row >= 0}
        note("events_taken_up", count=len(going_on), seconds=(now - found.time) * 1e-9)
        return going_on


@dataclass(frozen=True, eq=False, slots=True)
class Snapshot:
    """State of loops with an open event; every array has a row for each."""

    names: NDArray[np.str_]
    keys: NDArray[np.str_]
    time: int
    """When it was written [ns since 1970]."""
    arrays: dict[str, NDArray[Any]]
    version: int = FILE_VERSION


def take(engine: Engine, reorder: Reorder, now: int) -> Snapshot:
    """Copy what is known of the loops with an open event."""
    rows = engine.open_rows()[:KEPT_LOOPS]
    arrays = {**engine.known(rows), "order": reorder.state[rows], "held": reorder.held[rows]}
    names, keys = (np.array([getattr(engine.loops[k], n) for k in rows], np.str_) for n in ("name", "key"))
    return Snapshot(names, keys, now, arrays)


def write(path: Path, snapshot: Snapshot) -> None:
    """Write it whole or not at all.

    Raises
    ------
    OSError
        Disk full, read-only.
    """
    columns: dict[str, Any] = {"names": snapshot.names, "keys": snapshot.keys, **snapshot.arrays}
    file = io.BytesIO()
    np.savez(file, version=np.array([snapshot.version]), time=np.array([snapshot.time]), **columns)
    write_bytes(path, file.getbuffer())


def read(path: Path) -> Snapshot | None:
    """Read what was written; None where there is nothing, or nothing that can be used (which is logged)."""
    try:
        with path.open("rb") as raw, np.load(raw, allow_pickle=False) as file:
            arrays = {name: file[name] for name in file.files}
        names, keys, time = arrays.pop("names"), arrays.pop("keys"), int(arrays.pop("time")[0])
        version = int(arrays.pop("version", [1])[0])
    except FileNotFoundError:
        return None
    except Exception as error:  # noqa: BLE001 (a damaged file raises whatever its bytes lead to)
        note("snapshot_damaged", path=path, why=error)
        return None
    return Snapshot(names, keys, time, arrays, version)


def fits(snapshot: Snapshot, engine: Engine, reorder: Reorder) -> bool:
    """Whether a snapshot's layout is that of this version."""
    arrays, n = snapshot.arrays, len(snapshot.names)
    expected = {**engine.known(np.zeros(0, np.intp)), "order": reorder.state, "held": reorder.held}
    return snapshot.version == FILE_VERSION and all(
        name in arrays and arrays[name].dtype == array.dtype and arrays[name].shape == (n, *array.shape[1:])
        for name, array in expected.items()
    )


def put_back(
    snapshot: Snapshot, rows: NDArray[np.int64], engine: Engine, reorder: Reorder, arrival: float
) -> None:
    """Take up the loops of a snapshot that fits again, as ``rows`` of the table.

    Parameters
    ----------
    rows
        (N,) row of each of its loops, -1 for those that are not watched any more.
    arrival
        Monotonic time [s]: since then they have sent nothing.
    """
    arrays = snapshot.arrays
    for k in np.flatnonzero(rows >= 0):
        row = int(rows[k])
        engine.adopt(row, {name: array[k] for name, array in arrays.items()})
        _order_back(reorder, row, arrays["order"][k], arrays["held"][k], arrival)


def _order_back(reorder: Reorder, row: int, state: np.void, held: NDArray[Any], arrival: float) -> None:
    """Put one loop's order back; clocks of this process count from another start."""
    if (
        state["wide"] >= 0 or not 0 <= state["count"] <= HELD_ENTRIES
    ):  # held elsewhere: two seconds of a fast loop
        state["count"] = 0
    state["wide"], state["run"], state["arrival"] = -1, 0, arrival
    reorder.state[row], reorder.held[row] = state, held
    reorder.waiting += int(state["count"])
