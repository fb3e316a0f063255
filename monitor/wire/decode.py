"""Bytes to entries: tags, samples, settings and frames.

A payload that cannot be read is a count by cause, never an exception.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any
from urllib.parse import unquote

import msgspec
import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from monitor.contract.entries import (
    ENTRY,
    MODE_UNKNOWN,
    MOST_PAYLOAD_BYTES,
    SAMPLE,
    TAG_AUTO,
    TAG_OP,
    TAG_PV,
    TAG_SP,
    Entries,
    Message,
)
from monitor.contract.loop_fields import parse_row
from monitor.contract.loops import MOST_NAME_BYTES, Loop, LoopTable
from monitor.contract.quality import quality_of
from monitor.contract.times import EARLIEST_NS, LATEST_NS, time_of

from .arrow import frame_entries, read_frame
from .arrow_header import claim
from .encode import decode_object

MOST_FRAME_ROWS = 1_000_000
"""Rows of a frame above which it is refused."""
MOST_FRAME_BATCHES = 256
"""Record batches of a frame above which it is refused."""
MOST_DECOMPRESSED_BYTES = 64 * 2**20
"""Bytes to which a frame may decompress: those of the most rows."""
MOST_MISSED_FRAMES = 2**32
"""Frames that can be missing; a number that leaps further is a new numbering."""
REMEMBERED_BYTES = 64 * 2**20
"""Of frames whose loops' names are remembered: a thousand streams of a thousand loops."""
MOST_KEYS = 10_000
"""Frame streams whose numbers and names are remembered."""
_TAGS = {"sp": TAG_SP, "op": TAG_OP, "auto": TAG_AUTO, "pv": TAG_PV}


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
        self.settings: tuple[int, Loop] | None = None
        """Settings (row, loop with them) with which the last call ended: what came before them acts before."""
        self.ahead: set[int] = set()
        """Loops whose last sample was refused as lying in the future: the clock of their source is ahead."""
        self.refused: list[tuple[str, str, str]] = []
        """Payloads refused in the last call, the first of each cause and key: (cause, key, why)."""
        self._complained: set[tuple[str, str]] = set()
        self._streams: dict[str, _Stream] = {}
        self._remembered = 0
        """Bytes of the frames whose names are remembered: Arrow holds on to the whole of them."""

    def decode(self, messages: Iterable[Message], latest: int) -> Entries:
        """Return the entries (dtype `ENTRY`) of the messages, in their order, up to the first settings.

        Parameters
        ----------
        messages
            Where there may be settings among them, an iterator: what follows is left in it.
        latest
            Samples after this time [ns] are refused as lying in the future.
        """
        self.settings = None
        self.refused.clear()
        parts: list[Entries] = []
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
                    if self.settings is not None:
                        break
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
        self._forget_names()

    def _forget_names(self) -> None:
        self._remembered = 0
        for stream in self._streams.values():
            stream.names, stream.loops = None, -1

    def _refuse(self, cause: str, key: str, error: Exception) -> None:
        self.causes[cause] += 1
        if (cause, key) not in self._complained and len(self._complained) < MOST_KEYS:
            self._complained.add((cause, key))
            self.refused.append((cause, key, (str(error).splitlines() or [type(error).__name__])[0][:200]))

    def _in_time(self, entries: Entries, latest: int) -> Entries:
        time = entries["time"]
        bad, future = (time < EARLIEST_NS) | (time > LATEST_NS), (time > latest) & (time <= LATEST_NS)
        if self.ahead and len(entries):
            self.ahead.difference_update(np.unique(entries["loop"][~(bad | future)]).tolist())
        if not (bad.any() or future.any()):
            return entries
        self.causes["bad_time"] += int(bad.sum())
        self.causes["future"] += int(future.sum())
        self._complain_of_times("bad_time", entries[bad], "no time from 2 January 1970 on")
        self._complain_of_times("future", entries[future], "ahead of this machine's clock")
        self.ahead.update(np.unique(entries["loop"][future]).tolist())
        return entries[~(bad | future)]

    def _complain_of_times(self, cause: str, entries: Entries, why: str) -> None:
        """Say once why samples are refused for their time, with the first loop of which it is seen."""
        if len(entries) and (cause, "") not in self._complained:
            self._complained.add((cause, ""))
            first = entries[0]
            name = self.loops[int(first["loop"])].name
            stamp = f"{int(first['time']) * 1e-9:.3f} s since 1970"
            self.refused.append((cause, name, f"{stamp} is {why}; so are others, all are counted"))

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
        key = key[:MOST_NAME_BYTES]  # a name may be as long as a frame
        if key in self.unknown or len(self.unknown) < 100:
            self.unknown[key] += samples

    def _settings(self, row: int, payload: bytes) -> None:
        """Read new settings: columns of the loop table; what they do not name stays as it was."""
        old = msgspec.structs.asdict(self.loops[row])
        loop, wrong = parse_row(
            {**old, **decode_object(payload), "name": old["name"], "key": old["key"]}, [old["form"]]
        )
        if loop is None:
            raise ValueError("; ".join(wrong))
        self.settings = row, loop

    def _frame(self, message: Message) -> Entries:
        """Read an Arrow stream of samples; the whole of it or nothing."""
        claimed = claim(message.payload)
        if (
            claimed.rows > MOST_FRAME_ROWS
            or claimed.batches > MOST_FRAME_BATCHES
            or claimed.compressed > MOST_DECOMPRESSED_BYTES
        ):
            raise TooLargeError(
                f"a frame of {claimed.rows} rows in {claimed.batches} batches, expected at most {MOST_FRAME_ROWS} in "
                f"{MOST_FRAME_BATCHES}, decompressed {MOST_DECOMPRESSED_BYTES} bytes"
            )
        batches, seq = read_frame(message.payload)
        parts = [frame_entries(batch) for batch in batches]
        stream = self._streams.get(message.key)
        if stream is None:
            if len(self._streams) >= MOST_KEYS:
                self._streams.pop(next(iter(self._streams)))
            stream = self._streams[message.key] = _Stream()
        first = next((int(p["time"][0]) for p in parts if len(p)), 0)
        if seq is not None and not self._follows(stream, seq, first):
            return np.zeros(0, ENTRY)
        for part, batch in zip(parts, batches, strict=True):
            part["loop"] = self._loop_rows(batch.column("loop"), stream, len(message.payload))
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
        if seq - last <= MOST_MISSED_FRAMES:
            self.causes["missed_frames"] += seq - last - 1
        return True

    def _loop_rows(self, column: Any, stream: _Stream, size: int) -> NDArray[np.int32]:
        """Map names, of a frame of this size [bytes], to rows of the table, -1 for unknown ones."""
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
            self._remembered += size
            if self._remembered > REMEMBERED_BYTES:
                self._forget_names()
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


def _joined(parts: list[Entries]) -> Entries:
    """Put entries one behind the other, as plain words: NumPy copies records field by field."""
    if len(parts) == 1:
        return parts[0]
    return np.concatenate([np.zeros(0, np.int64), *(p.view(np.int64) for p in parts)]).view(ENTRY)


def _check_size(payload: bytes) -> None:
    if len(payload) > MOST_PAYLOAD_BYTES:
        raise TooLargeError(f"{len(payload)} bytes, expected at most {MOST_PAYLOAD_BYTES}")


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
        auto = MODE_UNKNOWN if math.isnan(number) else int(number != 0)
    sp, pv, op = (number if kind == k else nan for k in (TAG_SP, TAG_PV, TAG_OP))
    return (time, row, kind, auto, quality_of(quality), sp, pv, op)
