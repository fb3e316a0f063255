"""Reading a recording of the view back."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pyarrow as pa
import rerun.chunk as rc

from monitor.adapters.rerun_view import series


def read(path: Path) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Times [ns] and values (n,) or (n, m) of every series in a recording, in time order."""
    found: dict[str, list[tuple[np.ndarray, np.ndarray]]] = {}
    for chunk in rc.RrdReader(str(path)).stream():
        if chunk.is_static or series.TIMELINE not in chunk.timeline_names:
            continue
        batch = chunk.to_record_batch()
        if "Scalars:scalars" in batch.schema.names:
            times = batch[series.TIMELINE].cast(pa.int64()).to_numpy()
            values = batch["Scalars:scalars"].flatten().to_numpy(zero_copy_only=False)
            values = values if len(values) == len(times) else values.reshape(len(times), -1)
            found.setdefault(chunk.entity_path, []).append((times, values))
    joined = {k: tuple(np.concatenate(c) for c in zip(*v, strict=True)) for k, v in found.items()}
    orders = {k: np.argsort(t, kind="stable") for k, (t, _) in joined.items()}
    return {k: (t[orders[k]], v[orders[k]]) for k, (t, v) in joined.items()}


def paths(path: Path) -> set[str]:
    """All entity paths of a recording."""
    return {chunk.entity_path for chunk in rc.RrdReader(str(path)).stream()}


def texts(path: Path, entity: str) -> list[str]:
    """Documents logged to an entity, in no order."""
    found: list[str] = []
    for chunk in rc.RrdReader(str(path)).stream():
        if chunk.entity_path == entity:
            batch = chunk.to_record_batch()
            for name in ("TextDocument:text", "TextLog:text"):
                if name in batch.schema.names:
                    found += [t for t in batch[name].flatten().to_pylist() if t]
    return found
