"""Messages and frames, and what a decoder makes of them."""

from __future__ import annotations

import math
import random
import struct
import warnings
from typing import Any

import numpy as np
import pyarrow as pa

from monitor.contract.entries import Message
from monitor.contract.loops import Loop, LoopTable
from monitor.wire.decode import Decoder

NOW = 1_795_341_600 * 10**9  # 2026-11-22T10:00:00Z
MINUTE = 60 * 10**9
NAN = math.nan
FRAME = "plant/area1/frame"


def table(n: int = 5) -> LoopTable:
    return LoopTable([Loop(name=f"L{k}") for k in range(n)])


def decode(*messages: tuple[str, bytes], decoder: Decoder | None = None, latest: int = NOW + MINUTE) -> Any:
    """Decode with warnings as errors; returns the entries and the decoder, which acts on no settings."""
    decoder = decoder or Decoder(table())
    out, _ = decode_all(decoder, *messages, latest=latest)
    return out, decoder


def decode_all(
    decoder: Decoder, *messages: tuple[str, bytes], latest: int = NOW + MINUTE
) -> tuple[Any, list[tuple[int, Loop]]]:
    """Decode piece by piece, as the service does; returns the entries and all settings."""
    rest = iter([Message(key, payload, NOW) for key, payload in messages])
    parts, told = [], []
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        while True:
            parts.append(decoder.decode(rest, latest))
            if decoder.settings is None:
                return np.concatenate(parts), told
            told.append(decoder.settings)


def columns(n: int = 3, **other: Any) -> dict[str, Any]:
    """Columns of a frame of ``n`` samples of the loops L0, L1, ..."""
    ones = np.ones(n)
    return {
        "loop": pa.array([f"L{k % 5}" for k in range(n)]),
        "time": pa.array(NOW + np.arange(n) * 1000).cast(pa.timestamp("ns", "UTC")),
        "sp": pa.array(ones), "pv": pa.array(2 * ones), "op": pa.array(3 * ones),
        **other,
    }  # fmt: skip


def frame(
    cols: dict[str, Any] | None = None, seq: Any = None, compression: str | None = None, times: int = 1
) -> bytes:
    cols = columns() if cols is None else cols
    batch = pa.record_batch(list(cols.values()), names=list(cols))
    if seq is not None:
        batch = batch.replace_schema_metadata({"seq": str(seq)})
    sink = pa.BufferOutputStream()
    options = pa.ipc.IpcWriteOptions(compression=compression)
    with pa.ipc.new_stream(sink, batch.schema, options=options) as stream:
        for _ in range(times):
            stream.write_batch(batch)
    return bytes(sink.getvalue().to_pybytes())


def refused(decoder: Decoder) -> dict[str, int]:
    return {cause: n for cause, n in decoder.causes.items() if n}


def dictionary(codes: list[int | None], names: list[str | None], kind: Any = None) -> Any:
    return pa.DictionaryArray.from_arrays(pa.array(codes, kind or pa.int8()), pa.array(names, pa.string()))


def sources() -> list[bytes]:
    names = dictionary([k % 3 for k in range(20)], ["L0", "L1", "nobody"])
    views = pa.array([f"a long name of loop number {k}" for k in range(20)], pa.string_view())
    return [
        frame(columns(20)), frame(columns(20, loop=names), seq=5), frame(columns(20), compression="zstd"),
        frame(columns(20, loop=names), compression="lz4", times=2), frame(columns(20, loop=views)),
        frame(columns(20, more=pa.array([[1, 2], [3]] * 10), quality=pa.array(range(20)), auto=pa.array([True] * 20))),
    ]  # fmt: skip


def accounted(out: Any, decoder: Decoder, messages: int) -> None:
    assert len(decoder.causes) <= 7
    assert all(n > 0 for n in refused(decoder).values())
    if messages == 1:
        assert len(out) > 0 or sum(decoder.causes.values()) > 0
    assert ((out["loop"] >= 0) & (out["loop"] < len(decoder.loops))).all()
    assert np.isin(out["kind"], range(5)).all()


def damaged(rng: random.Random, count: int) -> None:
    """Decode streams with flipped bits, bytes and lengths, or cut off."""
    whole = sources()
    extremes = (0, 1, 127, 128, 255)
    for _ in range(count):
        stream = bytearray(rng.choice(whole))
        for _ in range(rng.choice((1, 1, 1, 2, 8))):
            at = rng.randrange(len(stream))
            stream[at] = rng.choice(
                (stream[at] ^ (1 << rng.randrange(8)), rng.choice(extremes), rng.randrange(256))
            )
        if rng.random() < 0.1:
            at = 4 * rng.randrange(len(stream) // 4 - 2)
            struct.pack_into("<q", stream, at, rng.choice((-1, 2**31 - 1, 2**31, 2**40, 2**62, -(2**63))))
        if rng.random() < 0.1:
            del stream[rng.randrange(len(stream)) :]
        out, decoder = decode((FRAME, bytes(stream)))
        accounted(out, decoder, 2)
