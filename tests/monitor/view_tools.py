"""What the tests of the view share: waiting with a deadline, and reading a recording back."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import psutil
import pyarrow as pa
import pytest
import rerun.chunk as rc

from monitor.adapters.rerun_view import picture


def until(condition: Callable[[], Any], seconds: float = 15.0) -> Any:
    """Wait for a condition, with a deadline."""
    deadline = time.monotonic() + seconds
    while not (result := condition()):
        if time.monotonic() > deadline:
            pytest.fail(f"waited {seconds} s in vain")
        time.sleep(0.02)
    return result


def read(path: Path) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Times [ns] and values of every series in a recording, in time order."""
    found: dict[str, list[tuple[np.ndarray, np.ndarray]]] = {}
    for chunk in rc.RrdReader(str(path)).stream():
        if chunk.is_static or picture.TIMELINE not in chunk.timeline_names:
            continue
        batch = chunk.to_record_batch()
        if "Scalars:scalars" in batch.schema.names:
            times = batch[picture.TIMELINE].cast(pa.int64()).to_numpy()
            values = batch["Scalars:scalars"].flatten().to_numpy(zero_copy_only=False)
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


def children(pid: int) -> list[int]:
    """Ids of a process's children."""
    return [child.pid for child in psutil.Process(pid).children()]


def gone(pid: int) -> bool:
    """Whether a process has ended, as a zombie at most."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0] == "Z"
    except FileNotFoundError:
        return True
