"""One data set, two ways in: as a historian's file through the audit, as messages through the live path.

The live path is the service itself, its decoder, its ordering and its store, with a bus of plain lists and a clock
that is told; `tests/monitor/service/test_run.py` shows the same over sockets. What both found must be equal.
"""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pandas as pd
import pyarrow as pa

from monitor.audit.run import run_audit
from monitor.audit.settings import AuditSettings
from monitor.contract.loop_fields import parse_row
from monitor.contract.loops import Loop, LoopTable
from monitor.contract.records import Assessment, Event, LoopRow
from monitor.service.config import Config
from monitor.service.service import Service
from tests.support.bus import FakeBus
from tests.support.plants import pi_loop, times
from tests.support.stores import quick

START = 1_767_225_600
"""2026-01-01 [s]."""
SECOND = 10**9
NAME = "LIC-101"
SETTINGS = {"name": NAME, "kp": 14.0, "ti": 20.0}
"""Those of the loop that `good` simulates: they suit it."""
CAUSES = ("ok", "uncertain", "bad_value", "bad_quality", "bad_time", "duplicate", "conflict", "late")
"""What both ways count alike; `ok` includes `uncertain`, `duplicate` includes `conflict`."""
LOST = ("bad_value", "bad_quality", "bad_time", "duplicate", "late", "future", "unknown_loop")
"""Why a sample that was read is not used; each has one reason."""


# ---------------------------------------------------------------------------------------------------
# the data


def steps(n: int, *at: tuple[int, float], start: float = 50.0) -> np.ndarray:
    """A set point that moves by these sizes at these samples."""
    sp = np.full(n, start)
    for k, size in at:
        sp[k:] += size
    return sp


def simulated(
    sp: Any,
    *,
    kp: float = 14.0,
    ti: float = 20.0,
    gain: float = 0.01,
    dead: int = 3,
    noise: float = 0.02,
    seed: int = 0,
    load: Any = None,
    period: float = 1.0,
    name: str = NAME,
    low: float = -np.inf,
    high: float = np.inf,
) -> pd.DataFrame:
    """A level under PI control, sampled once a ``period`` [s]; ``load`` adds to OP, whose limits are ``low, high``."""
    n = len(sp)
    pv, op = pi_loop(
        np.asarray(sp, float), kp=kp, ti=ti, gain=gain, dead=dead - 1, noise=noise, seed=seed, op0=40.0,
        period=period, low=low, high=high, load=(lambda _: 0.0) if load is None else load.__getitem__,
    )  # fmt: skip
    return pd.DataFrame({"loop": name, "time": times(n, period), "sp": sp, "pv": pv, "op": op})


def good(n: int = 700, at: int = 300, size: float = 5.0, **facts: Any) -> pd.DataFrame:
    """A loop with one set-point step, well tuned, clean."""
    return simulated(steps(n, (at, size)), **facts)


def text(data: pd.DataFrame, column: str, rows: Any, value: str) -> pd.DataFrame:
    """Put a text in place of a column's values."""
    out = data.astype({column: object})
    out.loc[rows, column] = value
    return out


# ---------------------------------------------------------------------------------------------------
# what comes out


@dataclass
class Outcome:
    """What one way through has found."""

    events: list[Assessment]
    rows: dict[str, LoopRow]
    counts: dict[str, int]
    opened: list[Event] = field(default_factory=list)
    """Openings and closings (live only)."""
    about: dict[str, Any] = field(default_factory=dict)
    """``audit.json``, or the monitor's status."""

    @property
    def row(self) -> LoopRow:
        """The only loop's row."""
        (row,) = self.rows.values()
        return row

    @property
    def event(self) -> Assessment:
        """The only event."""
        (event,) = self.events
        return event

    @property
    def states(self) -> list[str]:
        """How the events ended, in the order of time."""
        return [e.state for e in self.events]

    def counted(self, *, ok: int, **others: int) -> None:
        """Say what became of all samples; a cause that is not named must be 0."""
        expected = {**dict.fromkeys(CAUSES, 0), "ok": ok, **others}
        assert {name: self.counts[name] for name in expected} == expected


def same(a: Outcome, b: Outcome, *, counts: bool = True) -> None:
    """Both have the same events, the same rows of loops and, if wanted, the same counts."""
    assert [msgspec.structs.asdict(e) for e in a.events] == [msgspec.structs.asdict(e) for e in b.events]
    assert {n: msgspec.structs.asdict(r) for n, r in a.rows.items()} == {
        n: msgspec.structs.asdict(r) for n, r in b.rows.items()
    }
    if counts:
        assert {n: a.counts[n] for n in CAUSES} == {n: b.counts[n] for n in CAUSES}


def _sorted(events: Any) -> list[Assessment]:
    return sorted(events, key=lambda e: (e.loop, e.start, e.id))


# ---------------------------------------------------------------------------------------------------
# the audit


def write(data: pd.DataFrame, path: Path) -> Path:
    """Write rows as a historian would: whole nanoseconds as ISO times, any other time and value as it is."""
    data = data.drop(columns="arrival", errors="ignore")
    if path.suffix == ".parquet":
        for name in _objects(data):
            data[name] = [
                None if _missing(v) else v if isinstance(v, str) else repr(v) for v in data[name].tolist()
            ]
        data = data.assign(time=pd.to_datetime(data["time"], utc=True)) if _plain_time(data) else data
        data.to_parquet(path, index=False)
    else:
        if _plain_time(data):
            iso = np.datetime_as_string(data["time"].to_numpy().astype("M8[ns]"))
            data = data.assign(time=[t + "Z" for t in iso])
        data.to_csv(path, index=False)
    return path


def _objects(data: pd.DataFrame) -> list[str]:
    """Columns that hold more than numbers."""
    return [n for n in data.columns if n not in {"loop", "time"} and data[n].dtype.kind == "O"]


def _plain_time(data: pd.DataFrame) -> bool:
    return data["time"].dtype == np.int64


def _missing(value: Any) -> bool:
    return value is None or (isinstance(value, float) and math.isnan(value))


def audit(
    data: pd.DataFrame | Sequence[Path],
    folder: Path,
    suffix: str = ".csv",
    table: Sequence[dict[str, Any]] = (SETTINGS,),
    **options: Any,
) -> Outcome:
    """Audit a file of these rows (or files already written)."""
    folder.mkdir(parents=True, exist_ok=True)
    loops = folder / "loops.csv"
    pd.DataFrame(list(table)).to_csv(loops, index=False)
    paths = [write(data, folder / f"data{suffix}")] if isinstance(data, pd.DataFrame) else list(data)
    out = folder / f"out{suffix[1:]}"
    result = run_audit(paths, loops, out, AuditSettings(**options))
    assert result.exit_code == 0, result.problems
    about = json.loads((out / "audit.json").read_text())
    return Outcome(
        _sorted(result.events), {r.loop: r for r in result.rows}, result.counts, about=about,
    )  # fmt: skip


# ---------------------------------------------------------------------------------------------------
# the live path


class Live:
    """A monitor's service with a clock that is told; ``now`` is the wall clock [ns]."""

    def __init__(self, folder: Path, table: Sequence[dict[str, Any]] = (SETTINGS,), **config: Any) -> None:
        loops = []
        for row in table:
            loop, wrong = parse_row(row)
            assert loop is not None, wrong
            loops.append(loop)
        self.now = START * SECOND
        self.steady = 0.0
        """Monotonic clock [s]."""
        self.bus, self.heard = FakeBus(), list[Any]()
        self.store = quick(folder)
        self.loops: LoopTable = LoopTable(loops)
        self.service = Service(
            Config(loops="table" if loops else "", **config), self.loops, self.bus, self.store,
            heard=self.heard.append, clock=lambda: self.now, monotonic=lambda: self.steady,
        )  # fmt: skip

    def wait(self, seconds: float) -> None:
        """Let time pass, and tick."""
        self.now += round(seconds * SECOND)
        self.steady += seconds
        self.service.tick()

    def put(self, messages: Sequence[tuple[str, bytes]], seconds: float = 0.0) -> None:
        """Messages come in; then the service ticks."""
        for key, payload in messages:
            self.bus.put(key, payload, self.now)
        self.wait(seconds)

    def status(self) -> dict[str, Any]:
        """What the monitor says of itself."""
        return dict(msgspec.to_builtins(self.service.status()))

    def outcome(self, *, finish: bool = True) -> Outcome:
        """What was found; ends the service first."""
        if finish:
            self.service.finish()
        status = self.status()
        return Outcome(
            _sorted(r for r in self.heard if isinstance(r, Assessment)),
            {r.loop: r for r in self.service.rows()},
            {"ok": status["samples_ok"], **{k: v for k, v in status.items() if isinstance(v, int)}},
            [r for r in self.heard if isinstance(r, Event)],
            status,
        )

    def close(self) -> None:
        """Close the file."""
        self.store.close()


def key_of(name: str) -> str:
    """The loop's key, as the table gives it by default."""
    return LoopTable([Loop(name=name)])[0].key


def messages(data: pd.DataFrame, payload: str = "sample") -> list[list[tuple[str, bytes]]]:
    """For each row its messages: a JSON sample, or a tag for each value (set point and output first), or a frame."""
    if payload == "frame":
        return [[("plant/frame", frame_of(data.iloc[k : k + 1]))] for k in range(len(data))]
    keys = {name: key_of(name) for name in data["loop"].unique()}
    out = []
    for row in data.drop(columns="arrival", errors="ignore").to_dict("records"):
        key, fields = keys[row.pop("loop")], {k: v for k, v in row.items() if not _missing(v)}
        fields["t"] = _seconds(fields.pop("time"))
        if "quality" in fields:
            fields["q"] = fields.pop("quality")
        fields = {k: v.item() if isinstance(v, np.generic) else v for k, v in fields.items()}
        if payload == "sample":
            out.append([(key, json.dumps(fields).encode())])
            continue
        common = {k: fields[k] for k in ("t", "q") if k in fields}
        out.append(
            [
                (f"{key}/{tag}", json.dumps({"v": fields.get(tag), **common}).encode())
                for tag in ("sp", "op", "auto", "pv")
                if tag in fields or tag == "pv"
            ]
        )
    return out


def _seconds(time: Any) -> Any:
    return int(time) / SECOND if isinstance(time, int | np.integer) else time


def frame_of(data: pd.DataFrame) -> bytes:
    """These rows as one Arrow stream."""
    columns = {
        "loop": pa.array(data["loop"].tolist()),
        "time": pa.array(data["time"].to_numpy()).cast(pa.timestamp("ns", "UTC")),
        **{n: pa.array(data[n].to_numpy(np.float64)) for n in ("sp", "pv", "op")},
    }
    if "auto" in data:
        columns["auto"] = pa.array(data["auto"].to_numpy(np.bool_))
    if "quality" in data:
        columns["quality"] = pa.array(data["quality"].to_numpy(np.float64))
    batch = pa.record_batch(list(columns.values()), names=list(columns))
    sink = pa.BufferOutputStream()
    with pa.ipc.new_stream(sink, batch.schema) as stream:
        stream.write_batch(batch)
    return bytes(sink.getvalue().to_pybytes())


def live(
    data: pd.DataFrame,
    folder: Path,
    payload: str = "sample",
    table: Sequence[dict[str, Any]] = (SETTINGS,),
    *,
    every: float | None = None,
    **config: Any,
) -> Outcome:
    """Run the rows, as they stand, through the service.

    A row arrives at its ``arrival`` [ns] if it has one, else when it was sampled, but never before the one in front
    of it. The service ticks every so many seconds of arrival time (by default ten periods); a frame holds what
    arrived between two ticks.
    """
    monitor = Live(folder, table, **config)
    try:
        arrival = data["arrival" if "arrival" in data else "time"].to_numpy().astype(np.int64)
        arrival = np.maximum.accumulate(arrival)
        if every is None:
            moves = np.diff(arrival)
            every = max(10.0 * float(np.median(moves[moves > 0])) / SECOND, 10.0)
        turn = (arrival - arrival[0]) // round(every * SECOND)
        bounds = [*np.flatnonzero(np.diff(turn, prepend=-1)), len(data)]
        single = [] if payload == "frame" else messages(data, payload)
        for first, last in pairwise(bounds):
            seconds = (int(arrival[last - 1]) - monitor.now) / SECOND
            monitor.now = int(arrival[last - 1])
            monitor.steady += max(seconds, 0.0)
            if payload == "frame":
                monitor.put([("plant/frame", frame_of(data.iloc[first:last]))])
            else:
                monitor.put([m for k in range(first, last) for m in single[k]])
        return monitor.outcome()
    finally:
        monitor.close()


def both(
    data: pd.DataFrame,
    folder: Path,
    *,
    table: Sequence[dict[str, Any]] = (SETTINGS,),
    payloads: Sequence[str] = ("sample", "frame"),
    counts: bool = True,
    every: float | None = None,
    **options: Any,
) -> Outcome:
    """Run the data through the audit (CSV and Parquet) and the live path; all are equal. Return the audit's.

    Every sample that was read is used or has one cause; a frame is left out where its columns cannot hold the values.
    """
    first = audit(data, folder / "audit", ".csv", table, **options)
    others = {"parquet": audit(data, folder / "audit", ".parquet", table, **options)}
    for payload in payloads:
        if payload != "frame" or not _objects(data):
            others[payload] = live(data, folder / payload, payload, table, every=every)
    for way, other in others.items():
        try:
            same(first, other, counts=counts)
        except AssertionError as error:
            raise AssertionError(f"audit of a CSV file and {way} differ: {error}") from error
        assert other.counts["ok"] + sum(other.counts.get(n, 0) for n in LOST) == len(data), way
    return first
