"""Bytes to entries, records to bytes: the only file of the monitor that knows payloads.

A payload that cannot be read is a count by cause, never an exception.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any
from urllib.parse import unquote

import msgspec
import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from .loops import Loop, LoopTable, parse_row
from .records import TIMES, Assessment, Event, LoopRow, Suggestion, Window

SCHEMA = 1
FRAME_MIME = "application/vnd.apache.arrow.stream"
JSON_MIME = "application/json"
LARGEST = 16 * 2**20
"""Bytes of a payload above which it is refused unread."""
MOST_ROWS = 1_000_000
"""Rows of a frame above which it is refused."""
EARLIEST, LATEST = 86_400 * 10**9, 9_200_000_000 * 10**9
"""Times outside are no times: 1970 is a gateway's zero, and int64 nanoseconds end in 2262 [ns]."""

SAMPLE, TAG_SP, TAG_OP, TAG_AUTO, TAG_PV = range(5)
"""Kinds of entry; of equal times a tag's set point, output and mode come before its PV."""
_TAGS = {"sp": TAG_SP, "op": TAG_OP, "auto": TAG_AUTO, "pv": TAG_PV}

ENTRY = np.dtype(
    [
        ("time", np.int64),
        ("loop", np.int32),
        ("kind", np.int8),
        ("auto", np.int8),
        ("quality", np.uint8),
        ("sp", np.float64),
        ("pv", np.float64),
        ("op", np.float64),
    ]
)
"""One arrival: a whole sample, or one quantity of it."""


class _Tag(msgspec.Struct):
    v: float | bool | str | None = None
    t: float | str | None = None
    q: int = 192


class _Sample(msgspec.Struct):
    t: float | str | None = None
    sp: float | str | None = None
    pv: float | str | None = None
    op: float | str | None = None
    auto: bool | int | None = None
    q: int = 192


_decode_tag = msgspec.json.Decoder(_Tag | float | bool | str | None).decode
_decode_sample = msgspec.json.Decoder(_Sample).decode
_decode_object = msgspec.json.Decoder(dict[str, Any]).decode


@dataclass(frozen=True, slots=True)
class Message:
    """What came in under one key."""

    key: str
    payload: bytes
    time: int
    """The bus's timestamp, else the arrival: for samples that bring no time [ns since 1970]."""


class Decoder:
    """Messages to entries, by the keys of a loop table.

    Parameters
    ----------
    loops
        Looked up at every message, so that added loops are found.
    register
        Called with the (name, key) of a loop that is in no table, its key empty for the default; returns its
        row, or None to refuse it. By default all are refused.
    """

    def __init__(self, loops: LoopTable, register: Callable[[str, str], int | None] | None = None) -> None:
        self.loops = loops
        self._register = register
        self.causes: Counter[str] = Counter()
        """What was refused, by cause: ``malformed, unknown_loop, future, bad_time, too_large`` [samples or
        messages], and ``missed_frames, repeated_frames``."""
        self.unknown: Counter[str] = Counter()
        """The first keys or names that no loop has, with how often they came."""
        self.settings: list[tuple[int, Loop]] = []
        """Settings that arrived since the last call (row, loop with them)."""
        self._seq: dict[str, int] = {}

    def decode(self, messages: Iterable[Message], latest: int) -> NDArray[Any]:
        """Return the entries (dtype `ENTRY`) of the messages, in their order.

        Parameters
        ----------
        latest
            Samples after this time [ns] are refused as lying in the future.
        """
        self.settings.clear()
        parts: list[NDArray[Any]] = []
        single: list[tuple[Any, ...]] = []
        for message in messages:
            try:
                if len(message.payload) > LARGEST:
                    self.causes["too_large"] += 1
                    continue
                if message.key.endswith("/frame") or message.key == "frame":
                    if single:
                        parts.append(np.array(single, ENTRY))
                        single = []
                    parts.append(self._frame(message))
                else:
                    self._single(message, single)
            except (
                msgspec.DecodeError,
                UnicodeDecodeError,
                pa.ArrowException,
                ValueError,
                OverflowError,
                MemoryError,
            ):
                self.causes["malformed"] += 1
        if single:
            parts.append(np.array(single, ENTRY))
        entries = np.concatenate(parts) if parts else np.zeros(0, ENTRY)
        return self._in_time(entries, latest)

    def _in_time(self, entries: NDArray[Any], latest: int) -> NDArray[Any]:
        time = entries["time"]
        bad, future = (time < EARLIEST) | (time > LATEST), (time > latest) & (time <= LATEST)
        if not (bad.any() or future.any()):
            return entries
        self.causes["bad_time"] += int(bad.sum())
        self.causes["future"] += int(future.sum())
        return entries[~(bad | future)]

    def _single(self, message: Message, out: list[tuple[Any, ...]]) -> None:
        """Read a tag, a sample or settings."""
        key = message.key
        row = self.loops.by_key.get(key)
        if row is not None:
            out.append(_sample_entry(row, _decode_sample(message.payload), message.time))
            return
        stem, _, last = key.rpartition("/")
        if last in _TAGS:
            tag = _decode_tag(message.payload)
            row = self._row(stem)
            if row is not None:
                out.append(_tag_entry(row, _TAGS[last], tag, message.time))
        elif last == "settings":
            row = self.loops.by_key.get(stem)
            if row is None:
                self._not_known(stem)
            else:
                self._settings(row, message.payload)
        else:
            sample = _decode_sample(message.payload)
            row = self._row(key)
            if row is not None:
                out.append(_sample_entry(row, sample, message.time))

    def _row(self, key: str) -> int | None:
        """Return the row of a key, registered or None (and counted) where it is not known."""
        row = self.loops.by_key.get(key)
        if row is None and self._register is not None:
            row = self._register(unquote(key.removeprefix("plant/")), key)
        if row is None:
            self._not_known(key)
        return row

    def _not_known(self, key: str, samples: int = 1) -> None:
        self.causes["unknown_loop"] += samples
        if key in self.unknown or len(self.unknown) < 100:
            self.unknown[key] += samples

    def _settings(self, row: int, payload: bytes) -> None:
        """Read new settings: columns of the loop table; what they do not name stays as it was."""
        old = msgspec.structs.asdict(self.loops[row])
        loop, wrong = parse_row(
            {**old, **_decode_object(payload), "name": old["name"], "key": old["key"]}, [old["form"]]
        )
        if loop is None:
            raise ValueError("; ".join(wrong))
        self.settings.append((row, loop))

    def _frame(self, message: Message) -> NDArray[Any]:
        """Read an Arrow stream of samples; the whole of it or nothing."""
        with pa.ipc.open_stream(message.payload) as stream:
            names = set(stream.schema.names)
            if not {"loop", "time", "sp", "pv", "op"} <= names:
                raise ValueError("a frame has columns loop, time, sp, pv, op")
            seq = (stream.schema.metadata or {}).get(b"seq")
            batches = list(stream)
        if sum(len(b) for b in batches) > MOST_ROWS:
            raise ValueError("a frame with too many rows")
        parts = [self._batch(b) for b in batches]
        if seq is not None and not self._follows(message.key, int(seq)):
            return np.zeros(0, ENTRY)
        return np.concatenate(parts) if parts else np.zeros(0, ENTRY)

    def _follows(self, key: str, seq: int) -> bool:
        """Count what is missing between two frames; False for a frame that was seen already."""
        last = self._seq.get(key)
        self._seq[key] = seq
        if last is None or seq == last + 1 or seq < last:  # a lower number: its publisher began anew
            return True
        if seq == last:
            self.causes["repeated_frames"] += 1
            return False
        self.causes["missed_frames"] += seq - last - 1
        return True

    def _batch(self, batch: Any) -> NDArray[Any]:
        """Turn one record batch into entries."""
        rows = self._loop_rows(batch.column("loop"))
        out = np.zeros(len(rows), ENTRY)
        out["loop"], out["kind"], out["auto"], out["quality"] = rows, SAMPLE, 1, 192
        out["time"] = _times(batch.column("time"))
        for name in ("sp", "pv", "op"):
            out[name] = _numbers(batch.column(name))
        if "auto" in batch.schema.names:
            out["auto"] = batch.column("auto").fill_null(True).cast(pa.int8()).to_numpy(zero_copy_only=False)
        if "quality" in batch.schema.names:
            codes = batch.column("quality").fill_null(0).to_numpy(zero_copy_only=False)
            out["quality"] = np.clip(codes, 0, 255)
        return out[rows >= 0]

    def _loop_rows(self, column: Any) -> NDArray[np.int32]:
        """Map names to rows of the table, -1 for unknown ones."""
        if not pa.types.is_dictionary(column.type):
            column = column.cast(pa.string()).dictionary_encode()
        names = column.dictionary.to_pylist()
        found = np.array([self._named(n) for n in names] + [-1], np.int32)
        codes = column.indices.fill_null(len(names)).to_numpy(zero_copy_only=False)
        rows = np.asarray(found[codes], dtype=np.int32)
        if (rows < 0).any():
            for code, n in zip(*np.unique(codes[rows < 0], return_counts=True), strict=True):
                self._not_known(str(names[code]) if code < len(names) else "", int(n))
        return rows

    def _named(self, name: str | None) -> int:
        row = self.loops.by_name.get(name or "")
        if row is None and name and self._register is not None:
            row = self._register(name, "")
        return -1 if row is None else row


def _numbers(column: Any) -> NDArray[np.float64]:
    """Return a float column with NaN for nulls."""
    if not (pa.types.is_floating(column.type) or pa.types.is_integer(column.type)):
        raise ValueError("sp, pv and op are numbers")
    return np.asarray(column.cast(pa.float64()).to_numpy(zero_copy_only=False), dtype=np.float64)


def _times(column: Any) -> NDArray[np.int64]:
    """Return times [ns]; 0, which is refused later, for nulls."""
    if pa.types.is_timestamp(column.type):
        stamps = column.cast(pa.timestamp("ns", column.type.tz)).cast(pa.int64()).fill_null(0)
        return np.asarray(stamps.to_numpy(zero_copy_only=False), dtype=np.int64)
    return seconds_to_ns(_numbers(column))


def seconds_to_ns(seconds: NDArray[np.float64]) -> NDArray[np.int64]:
    """Epoch seconds to ns, rounded to the microsecond that a float can hold; 0 where they are none."""
    usable = np.isfinite(seconds) & (np.abs(seconds) < LATEST * 1e-9)
    return np.round(np.where(usable, seconds, 0.0) * 1e6).astype(np.int64) * 1000


def time_of(value: float | str | None, default: int) -> int:
    """Return the time of a sample [ns]: ISO text (naive = UTC), epoch seconds, else the default.

    Raises
    ------
    ValueError
        Text that is no time.
    """
    if value is None:
        return default
    if isinstance(value, str):
        when = datetime.fromisoformat(value)
        when = when.replace(tzinfo=UTC) if when.tzinfo is None else when
        delta = when - datetime(1970, 1, 1, tzinfo=UTC)
        return ((delta.days * 86_400 + delta.seconds) * 1_000_000 + delta.microseconds) * 1000
    return int(seconds_to_ns(np.float64(value).reshape(1))[0])


def _number(value: Any) -> float:
    """Return a number; text (the gateway's "Bad Input") and nothing are a missing value."""
    return float(value) if isinstance(value, int | float) else math.nan


def _sample_entry(row: int, sample: _Sample, time: int) -> tuple[Any, ...]:
    auto = 1 if sample.auto is None or sample.auto else 0
    return (
        time_of(sample.t, time), row, SAMPLE, auto, _quality(sample.q),
        _number(sample.sp), _number(sample.pv), _number(sample.op),
    )  # fmt: skip


def _tag_entry(row: int, kind: int, tag: Any, time: int) -> tuple[Any, ...]:
    value, quality = tag, 192
    if isinstance(tag, _Tag):
        value, quality, time = tag.v, tag.q, time_of(tag.t, time)
    nan = math.nan
    number = _number(value)
    auto = 0 if kind == TAG_AUTO and number == 0 else 1
    sp, pv, op = (number if kind == k else nan for k in (TAG_SP, TAG_PV, TAG_OP))
    return (time, row, kind, auto, _quality(quality), sp, pv, op)


def _quality(code: int) -> int:
    if not 0 <= code <= 255:
        raise ValueError("quality: an OPC code from 0 to 255")
    return code


# ---------------------------------------------------------------------------------------------------
# records to bytes

_encoder = msgspec.json.Encoder()


def iso(time: int) -> str:
    """Return a time [ns since 1970] as ISO 8601 with Z."""
    return str(np.datetime_as_string(np.datetime64(time, "ns"), unit="us")) + "Z"


def to_json(fields: dict[str, Any]) -> bytes:
    """Encode with ``schema``; NaN and infinity become null, times ISO text."""
    clean = {k: iso(v) if k in TIMES and isinstance(v, int) else _clean(v) for k, v in fields.items()}
    return _encoder.encode({"schema": SCHEMA, **clean})


def _clean(value: Any) -> Any:
    if isinstance(value, float) and not math.isfinite(value):
        return None
    if isinstance(value, dict):
        return {k: _clean(v) for k, v in value.items()}
    return value


def encode_record(record: Event | Assessment | LoopRow | Suggestion) -> bytes:
    """Return a record as JSON."""
    if isinstance(record, Suggestion):
        return to_json({**msgspec.structs.asdict(record.row), "evidence": record.evidence})
    return to_json(msgspec.structs.asdict(record))


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
