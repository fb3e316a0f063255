"""Exports of the same data in every layout, and reading them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from monitor.adapters.historian.clock import EXCEL_EPOCH_DAYS
from monitor.adapters.historian.merge import Span, sorted_samples
from monitor.adapters.historian.reader import inspect
from monitor.adapters.historian.rows import Tally
from monitor.adapters.historian.source import Source
from monitor.contract.samples import Samples
from tests.support.samples import join

START = np.datetime64("2026-03-01T00:00:00", "ns").astype(np.int64)
SECOND = 10**9
FIELDS = ("loop", "time", "sp", "pv", "op", "auto", "quality")
NAMES = ("LIC-101", "FIC 2.A")


def load(sources: Sequence[Source], wanted: Mapping[str, int], span: Span, tally: Tally) -> Samples:
    """Read everything at once."""
    parts = list(sorted_samples(sources, wanted, span, tally))
    return join(parts) if parts else Samples.of(0, [], [], [], [])


def frame(n: int = 40, seed: int = 0, auto: bool = True, quality: bool = True) -> pd.DataFrame:
    """Two loops of n rows, interleaved, one second apart."""
    rng = np.random.default_rng(seed)
    parts = []
    for name in NAMES:
        part = pd.DataFrame({"loop": name, "time": START + SECOND * np.arange(n)})
        for column in ("sp", "pv", "op"):
            part[column] = rng.normal(50, 10, n).round(3)
        if auto:
            part["auto"] = rng.random(n) > 0.3
        if quality:
            part["quality"] = rng.choice([0, 64, 192, 216], n)
        parts.append(part)
    return pd.concat(parts).sort_values(["time", "loop"], kind="stable").reset_index(drop=True)


def samples_of(data: pd.DataFrame) -> Samples:
    """What a reader has to make of it: by loop, then time."""
    data = data.assign(code=data["loop"].map(NAMES.index)).sort_values(["code", "time"], kind="stable")
    return Samples.of(
        data["code"], data["time"], data["sp"], data["pv"], data["op"],
        data.get("auto"), data.get("quality"),
    )  # fmt: skip


def as_text(data: pd.DataFrame) -> pd.DataFrame:
    return data.assign(time=pd.to_datetime(data["time"]).dt.strftime("%Y-%m-%dT%H:%M:%S.%fZ"))


def wide(data: pd.DataFrame, lower: bool = False) -> pd.DataFrame:
    out: pd.DataFrame | None = None
    for name, part in data.groupby("loop"):
        roles = {c: f"{name}.{c if lower else c.upper()}" for c in part.columns if c not in {"loop", "time"}}
        own = part.drop(columns="loop").rename(columns=roles)
        out = own if out is None else out.merge(own, on="time")
    assert out is not None
    return out


def write(data: pd.DataFrame, path: Path, time: str = "timestamp", **options: object) -> Path:
    data = data.copy()
    if time == "timestamp":
        data["time"] = pd.to_datetime(data["time"], utc=True)
    elif time == "text":
        data = as_text(data)
    elif time == "naive":
        data["time"] = pd.to_datetime(data["time"]).dt.strftime("%Y-%m-%d %H:%M:%S.%f")
    elif time == "excel":
        data["time"] = data["time"] / 86_400e9 + EXCEL_EPOCH_DAYS
    else:
        data["time"] = data["time"] / {"s": 1e9, "ms": 1e6, "us": 1e3}[time] if time != "ns" else data["time"]
    if path.suffix == ".parquet":
        data.to_parquet(path, index=False)
    else:
        data.to_csv(path, index=False, **options)  # type: ignore[call-overload]
    return path


def sources(*paths: Path, unit: str | None = None) -> list[Source]:
    return [inspect(p, p.name, NAMES, unit) for p in paths]


WANTED = {name: k for k, name in enumerate(NAMES)}


def all_of(
    *paths: Path, span: Span | None = None, tally: Tally | None = None, unit: str | None = None
) -> Samples:
    tally = Tally() if tally is None else tally
    return load(sources(*paths, unit=unit), WANTED, span or Span(), tally)


def equal(a: Samples, b: Samples) -> None:
    assert len(a) == len(b)
    for name in FIELDS:
        np.testing.assert_array_equal(getattr(a, name), getattr(b, name), err_msg=name)


def by_loop(samples: Samples) -> Samples:
    return samples.take(np.lexsort((samples.time, samples.loop)))
