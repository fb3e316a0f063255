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

from monitor.contract.loops import NAME_BYTES, Loop, LoopTable, parse_row
from monitor.contract.quality import opc_quality, quality_of
from monitor.contract.records import TIMES, Assessment, Event, LoopRow, Suggestion, Window
from monitor.contract.samples import GOOD

from .arrow_header import claim

SCHEMA = 1
FRAME_MIME = "application/vnd.apache.arrow.stream"
JSON_MIME = "application/json"
LARGEST = 16 * 2**20
"""Bytes of a payload above which it is refused unread."""
MOST_ROWS = 1_000_000
"""Rows of a frame above which it is refused."""
MOST_BATCHES = 256
"""Record batches of a frame above which it is refused."""
MOST_DECOMPRESSED = 64 * 2**20
"""Bytes to which a frame may decompress: those of the most rows."""
MOST_MISSED = 2**32
"""Frames that can be missing; a number that leaps further is a new numbering."""
MOST_KEYS = 10_000
"""Frame streams whose numbers and names are remembered."""
EARLIEST, LATEST = 86_400 * 10**9, 9_200_000_000 * 10**9
"""Times outside are no times: 1970 is a gateway's zero, and int64 nanoseconds end in 2262 [ns]."""

SAMPLE, TAG_SP, TAG_OP, TAG_AUTO, TAG_PV = range(5)
"""Kinds of entry; of equal times a tag's set point, output and mode come before its PV."""
UNKNOWN = -1
"""A mode that could not be read."""
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
    ],
    align=True,
)
"""One arrival: a whole sample, or one quantity of it. Aligned: 48 bytes, whose columns are read three times as fast."""


class _Tag(msgspec.Struct):
    v: float | bool | str | None = None
    t: float | str | None = None
    q: float | bool | str | None = None


class _Sample(msgspec.Struct):
    t: float | str | None = None
    sp: float | str | None = None
    pv: float | str | None = None
    op: float | str | None = None
    auto: bool | float | None = None
    q: float | bool | str | None = None


_decode_tag = msgspec.json.Decoder(_Tag | float | bool | str | None).decode
_decode_sample = msgspec.json.Decoder(_Sample).decode
_decode_object = msgspec.json.Decoder(dict[str, Any]).decode


class TooLargeError(ValueError):
    """A payload that is refused because of its size."""


@dataclass(slots=True)
class _Stream:
    """What is remembered of the frames under one key."""

    seq: int | None = None
    first: int = 0
    """Time of the last numbered frame's first sample [ns]."""
    names: Any = None
    """Dictionary of the last frame's loops, and the rows to which it led in a table of this length."""
    rows: Any = None
    loops: int = -1


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
        self.register = register
        self.causes: Counter[str] = Counter()
        """What was refused, by cause: ``malformed, unknown_loop, future, bad_time, too_large`` [samples or
        messages], and ``missed_frames, repeated_frames``."""
        self.unknown: Counter[str] = Counter()
        """The first keys or names that no loop has, with how often they came."""
        self.settings: list[tuple[int, Loop]] = []
        """Settings that arrived since the last call (row, loop with them)."""
        self.ahead: set[int] = set()
        """Loops whose last sample was refused as lying in the future: the clock of their source is ahead."""
        self.refused: list[tuple[str, str, str]] = []
        """Payloads refused in the last call, the first of each cause and key: (cause, key, why)."""
        self._complained: set[tuple[str, str]] = set()
        self._streams: dict[str, _Stream] = {}

    def decode(self, messages: Iterable[Message], latest: int) -> NDArray[Any]:
        """Return the entries (dtype `ENTRY`) of the messages, in their order.

        Parameters
        ----------
        latest
            Samples after this time [ns] are refused as lying in the future.
        """
        self.settings.clear()
        self.refused.clear()
        parts: list[NDArray[Any]] = []
        single: list[tuple[Any, ...]] = []
        for message in messages:
            try:
                _check_size(message.payload)
                if message.key.endswith("/frame") or message.key == "frame":
                    frame = self._frame(message)
                    if single:
                        parts.append(np.array(single, ENTRY))
                        single = []
                    parts.append(frame)
                else:
                    self._single(message, single)
            except TooLargeError as error:
                self._refuse("too_large", message.key, error)
            except (
                msgspec.DecodeError,
                pa.ArrowException,  # among them KeyError, IndexError, TypeError of its own
                ValueError,
                LookupError,
                OverflowError,
                OSError,  # Arrow's word for a body that is cut off
                MemoryError,
                RecursionError,
            ) as error:
                self._refuse("malformed", message.key, error)
        if single:
            parts.append(np.array(single, ENTRY))
        return self._in_time(_joined(parts), latest)

    def forget(self, row: int) -> None:
        """Forget where a loop's samples belong: its row is another's from now on."""
        self.ahead.discard(row)
        for stream in self._streams.values():
            stream.names, stream.loops = None, -1

    def _refuse(self, cause: str, key: str, error: Exception) -> None:
        self.causes[cause] += 1
        if (cause, key) not in self._complained and len(self._complained) < MOST_KEYS:
            self._complained.add((cause, key))
            self.refused.append((cause, key, (str(error).splitlines() or [type(error).__name__])[0][:200]))

    def _in_time(self, entries: NDArray[Any], latest: int) -> NDArray[Any]:
        time = entries["time"]
        bad, future = (time < EARLIEST) | (time > LATEST), (time > latest) & (time <= LATEST)
        if self.ahead and len(entries):
            self.ahead.difference_update(np.unique(entries["loop"][~(bad | future)]).tolist())
        if not (bad.any() or future.any()):
            return entries
        self.causes["bad_time"] += int(bad.sum())
        self.causes["future"] += int(future.sum())
        self.ahead.update(np.unique(entries["loop"][future]).tolist())
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
        if row is None and self.register is not None:
            row = self.register(unquote(key.removeprefix("plant/")), key)
        if row is None:
            self._not_known(key)
        return row

    def _not_known(self, key: str, samples: int = 1) -> None:
        self.causes["unknown_loop"] += samples
        key = key[:NAME_BYTES]  # a name may be as long as a frame
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
        claimed = claim(message.payload)
        if (
            claimed.rows > MOST_ROWS
            or claimed.batches > MOST_BATCHES
            or claimed.compressed > MOST_DECOMPRESSED
        ):
            raise TooLargeError(
                f"a frame of {claimed.rows} rows in {claimed.batches} batches, expected at most {MOST_ROWS} in "
                f"{MOST_BATCHES}, decompressed {MOST_DECOMPRESSED} bytes"
            )
        batches, seq = _read(message.payload)
        parts = [_samples(batch) for batch in batches]
        stream = self._streams.get(message.key)
        if stream is None:
            if len(self._streams) >= MOST_KEYS:
                self._streams.pop(next(iter(self._streams)))
            stream = self._streams[message.key] = _Stream()
        first = next((int(p["time"][0]) for p in parts if len(p)), 0)
        if seq is not None and not self._follows(stream, seq, first):
            return np.zeros(0, ENTRY)
        for part, batch in zip(parts, batches, strict=True):
            part["loop"] = self._loop_rows(batch.column("loop"), stream)
        entries = _joined(parts)
        known = entries["loop"] >= 0
        return entries if known.all() else entries[known]

    def _follows(self, stream: _Stream, seq: int, first: int) -> bool:
        """Count what is missing between two frames; False for a frame that was seen already."""
        last, then = stream.seq, stream.first
        stream.seq, stream.first = seq, first
        if last is None or seq == last + 1 or seq < last:  # a lower number: its publisher began anew
            return True
        if seq == last:
            if first != then:
                return True  # began anew, and came no further before
            self.causes["repeated_frames"] += 1
            return False
        if seq - last <= MOST_MISSED:
            self.causes["missed_frames"] += seq - last - 1
        return True

    def _loop_rows(self, column: Any, stream: _Stream) -> NDArray[np.int32]:
        """Map names to rows of the table, -1 for unknown ones."""
        if not pa.types.is_dictionary(column.type):
            column = column.cast(pa.string()).dictionary_encode()
        codes = column.indices
        if codes.null_count:
            codes = codes.cast(pa.int64()).fill_null(len(column.dictionary))
        codes = codes.to_numpy(zero_copy_only=False)
        names = column.dictionary
        # a publisher repeats its names in every frame
        if stream.loops != len(self.loops) or not names.equals(stream.names):
            stream.rows = np.full(len(names) + 1, -1, np.int32)
            used = np.unique(codes)
            used = used[used < len(names)]
            stream.rows[used] = [self._named(n) for n in names.take(pa.array(used)).to_pylist()]
            whole = len(used) == len(names)
            stream.names, stream.loops = (names, len(self.loops)) if whole else (None, -1)
        rows = stream.rows[codes]
        if (rows < 0).any():
            for code, n in zip(*np.unique(codes[rows < 0], return_counts=True), strict=True):
                self._not_known(str(names[int(code)].as_py() or "") if code < len(names) else "", int(n))
        return np.asarray(rows, dtype=np.int32)

    def _named(self, name: str | None) -> int:
        row = self.loops.by_name.get(name or "")
        if row is None and name and self.register is not None:
            row = self.register(name, "")
        return -1 if row is None else row


def _joined(parts: list[NDArray[Any]]) -> NDArray[Any]:
    """Put entries one behind the other, as plain words: NumPy copies records field by field."""
    if len(parts) == 1:
        return parts[0]
    return np.concatenate([np.zeros(0, np.int64), *(p.view(np.int64) for p in parts)]).view(ENTRY)


def _check_size(payload: bytes) -> None:
    if len(payload) > LARGEST:
        raise TooLargeError(f"{len(payload)} bytes, expected at most {LARGEST}")


_NEEDED = ("loop", "time", "sp", "pv", "op")
_OPTIONAL = ("auto", "quality")


def _read(payload: bytes) -> tuple[list[Any], int | None]:
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


def _samples(batch: Any) -> NDArray[Any]:
    """Turn one record batch into entries, their loops still to be found."""
    out = np.zeros(len(batch), ENTRY)
    out["kind"], out["auto"], out["quality"] = SAMPLE, 1, GOOD
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
    factor = _UNITS[column.type.unit]
    stamps = np.asarray(column.to_numpy(zero_copy_only=False).view(np.int64))  # null: far before any time
    if factor > 1:  # those beyond the years that nanoseconds can hold are none
        most = LATEST // factor
        stamps = np.where((stamps >= -most) & (stamps <= most), stamps, 0) * factor
    return np.asarray(stamps, dtype=np.int64)


_UNITS = {"ns": 1, "us": 10**3, "ms": 10**6, "s": 10**9}


def seconds_to_ns(seconds: NDArray[np.float64]) -> NDArray[np.int64]:
    """Epoch seconds to ns, rounded to the microsecond that a float can hold; 0 where they are none."""
    usable = np.isfinite(seconds) & (np.abs(seconds) < LATEST * 1e-9)
    return np.round(np.where(usable, seconds, 0.0) * 1e6).astype(np.int64) * 1000


EPOCH = datetime(1970, 1, 1, tzinfo=UTC)


def time_of(value: float | str | None, default: int) -> int:
    """Return the time of a sample [ns]: ISO text (naive = UTC), epoch seconds, else the default; 0 out of range.

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
        delta = when - EPOCH
        time = ((delta.days * 86_400 + delta.seconds) * 1_000_000 + delta.microseconds) * 1000
        return time if abs(time) <= LATEST else 0
    # as `seconds_to_ns`, at a tenth of its cost
    return round(value * 1e6) * 1000 if math.isfinite(value) and abs(value) < LATEST * 1e-9 else 0


def _number(value: Any) -> float:
    """Return a number; text (the gateway's "Bad Input") and nothing are a missing value."""
    return float(value) if isinstance(value, int | float) else math.nan


def _sample_entry(row: int, sample: _Sample, time: int) -> tuple[Any, ...]:
    auto = 1 if sample.auto is None or sample.auto else 0
    return (
        time_of(sample.t, time), row, SAMPLE, auto, quality_of(sample.q),
        _number(sample.sp), _number(sample.pv), _number(sample.op),
    )  # fmt: skip


def _tag_entry(row: int, kind: int, tag: Any, time: int) -> tuple[Any, ...]:
    value, quality = tag, None
    if isinstance(tag, _Tag):
        value, quality, time = tag.v, tag.q, time_of(tag.t, time)
    nan = math.nan
    number = _number(value)
    auto = 1
    if kind == TAG_AUTO:
        auto = UNKNOWN if math.isnan(number) else int(number != 0)
    sp, pv, op = (number if kind == k else nan for k in (TAG_SP, TAG_PV, TAG_OP))
    return (time, row, kind, auto, quality_of(quality), sp, pv, op)


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
    if isinstance(value, float):  # NumPy's too, which JSON knows nothing of
        return float(value) if math.isfinite(value) else None
    if isinstance(value, dict):
        return {k: _clean(v) for k, v in value.items()}
    return value


def encode_record(record: Event | Assessment | LoopRow | Suggestion) -> bytes:
    """Return a record as JSON."""
    if isinstance(record, Suggestion):
        return to_json({**msgspec.structs.asdict(record.row), "evidence": record.evidence})
    return to_json(msgspec.structs.asdict(record))


def decode_event(payload: bytes) -> Event:
    """Read an event that `encode_record` wrote; one that cannot be read is of no loop."""
    try:
        fields = _decode_object(payload)
        start = time_of(fields["start"], 0)
        return msgspec.convert({**fields, "start": start, "end": None}, Event)
    except (msgspec.MsgspecError, KeyError, ValueError, TypeError):
        return Event(id="", loop="", kind="", state="", start=0, end=None, amplitude=0.0)


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
