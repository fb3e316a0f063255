"""What an Arrow stream claims to hold, read from its headers alone: before a byte of it is decoded.

A stream of a few kilobytes can claim, or decompress to, gigabytes. The headers (flatbuffers, whose layout is
fixed by Arrow's ``Message.fbs``) say how much, so that it is refused before anything is allocated.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass

SCHEMA_MESSAGE, DICTIONARY_MESSAGE, RECORDS_MESSAGE = 1, 2, 3
"""Kinds of message."""
_CONTINUES = 0xFFFFFFFF
_u16, _u32, _i32, _i64 = (struct.Struct(f"<{c}").unpack_from for c in "HIiq")


@dataclass(slots=True)
class Claim:
    """What a stream says that it holds."""

    batches: int = 0
    """Record batches."""
    rows: int = 0
    """Rows of all record batches."""
    compressed: int = 0
    """Bytes to which its compressed buffers decompress."""


def claim(payload: bytes) -> Claim:
    """Walk through a stream's messages.

    Raises
    ------
    ValueError
        It is none: a length leads out of it.
    """
    out, at = Claim(), 0
    try:
        while at + 4 <= len(payload):
            (size,) = _u32(payload, at)
            at += 4
            if size == _CONTINUES:
                (size,) = _u32(payload, at)
                at += 4
            if size == 0:  # the end of the stream
                break
            root = at + _u32(payload, at)[0]
            kind = _field(payload, root, 1)
            header = _field(payload, root, 2)
            body = _field(payload, root, 3)
            at += size
            length = _i64(payload, body)[0] if body else 0
            if length < 0 or at + length > len(payload):
                raise ValueError("an Arrow stream that is cut off")
            if kind and header and payload[kind] in {DICTIONARY_MESSAGE, RECORDS_MESSAGE}:
                table = header + _u32(payload, header)[0]
                if payload[kind] == DICTIONARY_MESSAGE:
                    data = _field(payload, table, 1)
                    table = data + _u32(payload, data)[0]
                else:
                    rows = _field(payload, table, 0)
                    out.batches += 1
                    out.rows += max(_i64(payload, rows)[0], 0) if rows else 0
                out.compressed += _decompressed(payload, table, at, length)
            at += length
    except (struct.error, IndexError):
        raise ValueError("an Arrow stream whose lengths lead out of it") from None
    return out


def _field(payload: bytes, table: int, number: int) -> int:
    """Return where a table's field stands, 0 where it is left out."""
    layout = table - _i32(payload, table)[0]
    if layout < 0:
        raise ValueError("an Arrow stream whose lengths lead out of it")
    slot = 4 + 2 * number
    if slot + 2 > _u16(payload, layout)[0]:
        return 0
    (offset,) = _u16(payload, layout + slot)
    return table + offset if offset else 0


def _decompressed(payload: bytes, table: int, body: int, length: int) -> int:
    """Return to how many bytes a batch's buffers decompress: each begins with its length, -1 for "as it is"."""
    if not _field(payload, table, 3):
        return 0
    where = _field(payload, table, 2)
    if not where:
        return 0
    vector = where + _u32(payload, where)[0]
    (count,) = _u32(payload, vector)
    if vector + 4 + 16 * count > body:
        raise ValueError("an Arrow stream whose lengths lead out of it")
    total = 0
    for k in range(count):
        offset, size = _i64(payload, vector + 4 + 16 * k)[0], _i64(payload, vector + 12 + 16 * k)[0]
        if size <= 0:
            continue
        if not 0 <= offset <= offset + size <= length or size < 8:
            raise ValueError("an Arrow stream whose lengths lead out of it")
        total += max(_i64(payload, body + offset)[0], 0)
    return total
