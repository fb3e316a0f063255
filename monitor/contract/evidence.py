"""What the view takes in: windows, trends and records, from the bytes that the monitor publishes."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import UTC, datetime
from typing import Any, NamedTuple

import msgspec
import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Nanos = NDArray[np.int64]

ROWS_MAX = 200_000
"""Rows of one payload: a window holds some hundred."""


class Window(NamedTuple):
    """Evidence of one event: columns of equal length ``(N,)``, NaN where nothing is known."""

    id: str
    loop: str
    onset: int
    """When the step happened [ns since 1970, UTC]."""
    time: Nanos
    """[ns since 1970, UTC]."""
    sp: Floats
    """[PV]."""
    pv: Floats
    """[PV]."""
    op: Floats
    """[OP]."""
    model: Floats
    """PV as the fitted model gives it [PV]."""


class Trend(NamedTuple):
    """New samples of one loop: columns of equal length ``(N,)``."""

    loop: str
    time: Nanos
    """[ns since 1970, UTC]."""
    sp: Floats
    """[PV]."""
    pv: Floats
    """[PV]."""
    op: Floats
    """[OP]."""


class Pane(NamedTuple):
    """One loop of the layout and the event that its charts are fitted to."""

    loop: str
    start: int
    """First time of the event's window [ns]; equal to ``end`` where there is no window."""
    end: int
    """Last time of the event's window [ns]."""


def decode_window(payload: bytes) -> Window:
    """Read an event's window, an Arrow IPC stream.

    Raises
    ------
    ValueError
        It is no such stream, or a column or a fact is missing.
    """
    table, facts = _table(payload)
    time, sp, pv, op, model = _columns(table, ("sp", "pv", "op", "model"))
    return Window(facts["id"], facts["loop"], int(facts.get("onset", time[0])), time, sp, pv, op, model)


def decode_trend(payload: bytes) -> Trend:
    """Read new samples of a loop, an Arrow IPC stream. Raises as ``decode_window``."""
    table, facts = _table(payload)
    time, sp, pv, op = _columns(table, ("sp", "pv", "op"))
    return Trend(facts["loop"], time, sp, pv, op)


def decode_record(payload: bytes) -> dict[str, Any]:
    """Read an event, an assessment, a row or a health record, a JSON object.

    Raises
    ------
    ValueError
        It is no JSON object.
    """
    record = msgspec.json.decode(payload)
    if not isinstance(record, dict):
        raise ValueError("no JSON object")  # noqa: TRY004 - one kind of error for one bad payload
    return record


def merge(trends: Sequence[Trend]) -> Trend:
    """Join parts of one loop's trend, given in the order of their arrival, in the order of time."""
    columns = [np.concatenate([part[i] for part in trends]) for i in range(1, 5)]
    order = np.argsort(columns[0], kind="stable")
    time, sp, pv, op = (column[order] for column in columns)
    return Trend(trends[0].loop, time, sp, pv, op)


def nanoseconds(iso: object) -> int | None:
    """ISO time with zone (without: UTC) as [ns since 1970]; None where it is no time."""
    try:
        moment = datetime.fromisoformat(iso) if isinstance(iso, str) else None
    except ValueError:
        return None
    if moment is None:
        return None
    moment = moment if moment.tzinfo else moment.replace(tzinfo=UTC)
    return round(moment.timestamp() * 1e6) * 1000


def _table(payload: bytes) -> tuple[pa.Table, dict[str, str]]:
    try:
        table = pa.ipc.open_stream(payload).read_all()
        facts = {k.decode(): v.decode() for k, v in (table.schema.metadata or {}).items()}
    except (pa.ArrowException, UnicodeDecodeError, OSError) as error:
        raise ValueError(f"no Arrow stream: {error}") from error
    if not 0 < table.num_rows <= ROWS_MAX:
        raise ValueError(f"{table.num_rows} rows")
    return table, facts


def _columns(table: pa.Table, names: Sequence[str]) -> list[Any]:
    """Column ``time`` [ns], then ``names`` as float64 with NaN for null; ValueError if not there."""
    for name in ("time", *names):
        if table.schema.get_field_index(name) < 0:
            raise ValueError(f"no column {name!r}")
    try:
        time = table["time"].cast(pa.timestamp("ns", "UTC")).cast(pa.int64())
        if time.null_count:
            raise ValueError("time with nulls")
        floats = [table[name].cast(pa.float64()) for name in names]
    except pa.ArrowException as error:
        raise ValueError(f"a column of another type: {error}") from error
    return [time.to_numpy(), *(column.to_numpy() for column in floats)]
