"""Arrow streams: frames of samples in, windows and trends out and back."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from monitor.contract.entries import ENTRY, SAMPLE, Entries
from monitor.contract.evidence import Trend, Window
from monitor.contract.quality import opc_quality
from monitor.contract.samples import QUALITY_GOOD
from monitor.contract.times import LATEST_NS, UNIT_NS, seconds_to_ns

_NEEDED = ("loop", "time", "sp", "pv", "op")
_OPTIONAL = ("auto", "quality")


def read_frame(payload: bytes) -> tuple[list[Any], int | None]:
    """Return the record batches of a frame, checked, and its number."""
    options = pa.ipc.IpcReadOptions(use_threads=False)
    stream = pa.ipc.open_stream(payload, options=options)
    schema = stream.schema
    wanted = [k for k, n in enumerate(schema.names) if n in _NEEDED or n in _OPTIONAL]
    names = [schema.names[k] for k in wanted]
    if not set(_NEEDED) <= set(names) or len(set(names)) < len(names):
        raise ValueError("a frame has columns loop, time, sp, pv, op, each once")
    for name in names:
        _check_type(name, schema.field(name).type)
    if len(wanted) < len(schema.names):  # what we do not know we do not decode
        options.included_fields = wanted
        stream = pa.ipc.open_stream(payload, options=options)
    seq = (schema.metadata or {}).get(b"seq")
    if seq is not None and len(seq) > 20:
        raise ValueError("seq: expected a number of 64 bits")
    batches = []
    for batch in stream:
        batch.validate(full=True)  # offsets and codes that lead out of their buffers
        batches.append(batch)
    return batches, None if seq is None else int(seq)


def _check_type(name: str, kind: Any) -> None:
    """Refuse a column of another type."""
    is_ = pa.types
    if name == "loop":
        plain = kind.value_type if is_.is_dictionary(kind) else kind
        ok = is_.is_string(plain) or is_.is_large_string(plain) or is_.is_string_view(plain)
    else:
        ok = is_.is_floating(kind) or is_.is_integer(kind)
        ok |= (name == "time" and is_.is_timestamp(kind)) or (name == "auto" and is_.is_boolean(kind))
    if not ok:
        raise ValueError(f"a frame with a column {name} of type {str(kind)[:50]}")


def frame_entries(batch: Any) -> Entries:
    """Turn one record batch into entries, their loops still to be found."""
    out = np.zeros(len(batch), ENTRY)
    out["kind"], out["auto"], out["quality"] = SAMPLE, 1, QUALITY_GOOD
    out["time"] = _times(batch.column("time"))
    for name in ("sp", "pv", "op"):
        out[name] = _numbers(batch.column(name))
    if "auto" in batch.schema.names:
        column = batch.column("auto")
        if pa.types.is_boolean(column.type) and not column.null_count:
            out["auto"] = column.to_numpy(zero_copy_only=False)
        else:  # what is missing counts as automatic
            out["auto"] = (
                _numbers(column.cast(pa.int8()) if pa.types.is_boolean(column.type) else column) != 0
            )
    if "quality" in batch.schema.names:
        out["quality"] = opc_quality(_numbers(batch.column("quality")))
    return out


def _numbers(column: Any) -> NDArray[np.float64]:
    """Return a float column with NaN for nulls."""
    column = column if column.type == pa.float64() else column.cast(pa.float64(), safe=False)
    return np.asarray(column.to_numpy(zero_copy_only=False), dtype=np.float64)


def _times(column: Any) -> NDArray[np.int64]:
    """Return times [ns]; 0, which is refused later, for nulls."""
    if not pa.types.is_timestamp(column.type):
        return seconds_to_ns(_numbers(column))
    factor = UNIT_NS[column.type.unit]
    stamps = np.asarray(column.to_numpy(zero_copy_only=False).view(np.int64))  # null: far before any time
    if factor > 1:  # those beyond the years that nanoseconds can hold are none
        most = LATEST_NS // factor
        stamps = np.where((stamps >= -most) & (stamps <= most), stamps, 0) * factor
    return np.asarray(stamps, dtype=np.int64)


def encode_window(window: Window, verdict: str, reason: str) -> bytes:
    """Return an event's evidence as an Arrow stream: ``time, sp, pv, op, model``; the rest in the metadata."""
    columns = {"sp": window.sp, "pv": window.pv, "op": window.op, "model": window.model}
    about = {
        "id": window.id, "loop": window.loop, "onset": str(window.onset), "verdict": verdict, "reason": reason,
    }  # fmt: skip
    return _stream(window.time, columns, about)


def encode_trend(loop: str, time: NDArray[np.int64], columns: dict[str, NDArray[np.float64]]) -> bytes:
    """Return new samples of one loop as an Arrow stream: ``time`` and the columns."""
    return _stream(time, columns, {"loop": loop})


def _stream(time: NDArray[np.int64], columns: dict[str, NDArray[np.float64]], about: dict[str, str]) -> bytes:
    arrays = [pa.array(time).cast(pa.timestamp("ns", "UTC")), *(pa.array(c) for c in columns.values())]
    batch = pa.record_batch(arrays, names=["time", *columns])
    batch = batch.replace_schema_metadata(about)
    sink = pa.BufferOutputStream()
    with pa.ipc.new_stream(sink, batch.schema) as stream:
        stream.write_batch(batch)
    return bytes(sink.getvalue().to_pybytes())


MOST_SHOWN_ROWS = 200_000
"""Rows of one payload: a window holds some hundred."""


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


def _table(payload: bytes) -> tuple[pa.Table, dict[str, str]]:
    try:
        table = pa.ipc.open_stream(payload).read_all()
        facts = {k.decode(): v.decode() for k, v in (table.schema.metadata or {}).items()}
    except (pa.ArrowException, UnicodeDecodeError, OSError) as error:
        raise ValueError(f"no Arrow stream: {error}") from error
    if not 0 < table.num_rows <= MOST_SHOWN_ROWS:
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
