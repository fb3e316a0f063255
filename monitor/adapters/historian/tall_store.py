"""Single tags of exports that are larger than memory: read once, cut by loops onto disk, read back a part at a time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from .rows import Tally
from .source import Source
from .tall import ROLES, Series, series_of

ON_DISK = np.dtype([("tag", "<i4"), ("time", "<i8"), ("value", "<f8"), ("quality", "u1"), ("row", "<i8")])
"""A value as it lies there: 29 bytes."""


class TagStore:
    """Files of values, one for each part of the loops and each export.

    Parameters
    ----------
    folder
        Empty; it takes 29 bytes for each row of the exports.
    sources
        Exports of single tags.
    parts
        Loops of each part: name to code.
    """

    def __init__(
        self, folder: Path, sources: Sequence[Source], parts: Sequence[Mapping[str, int]], tally: Tally
    ) -> None:
        self.folder, self.sources = folder, sources
        wanted = {name: code for part in parts for name, code in part.items()}
        part_of = np.zeros(max(wanted.values(), default=-1) + 1, np.int64)
        for k, part in enumerate(parts):
            part_of[list(part.values())] = k
        for number, source in enumerate(sources):
            files = [self._path(k, number).open("wb") for k in range(len(parts))]
            try:
                for series in series_of(source, wanted, tally):
                    where = part_of[series.tag // ROLES]
                    for k in np.unique(where):
                        files[k].write(_packed(series, where == k).tobytes())
            finally:
                for file in files:
                    file.close()

    def part(self, k: int) -> list[tuple[Source, Series]]:
        """Return what the exports have of a part's loops, and forget it on disk."""
        out = []
        for number, source in enumerate(self.sources):
            path = self._path(k, number)
            packed = np.fromfile(path, ON_DISK)
            path.unlink()
            if len(packed):
                out.append(
                    (source, Series(*(np.ascontiguousarray(packed[name]) for name in ON_DISK.names or ())))
                )
        return out

    def _path(self, k: int, number: int) -> Path:
        return self.folder / f"{k}-{number}"


def _packed(series: Series, rows: NDArray[np.bool_]) -> NDArray[np.void]:
    out = np.empty(int(rows.sum()), ON_DISK)
    for name in ON_DISK.names or ():
        out[name] = getattr(series, name)[rows]
    return out
