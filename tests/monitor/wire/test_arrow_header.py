"""What a frame declares is looked at before it is believed."""

from __future__ import annotations

import struct
import tracemalloc

import numpy as np
import pyarrow as pa

from tests.monitor.wire.tools import FRAME, columns, decode, dictionary, frame, refused


def test_a_frame_that_decompresses_to_gigabytes_is_refused_unread():
    """A small stream that claims much: too large, and nothing is allocated for it."""
    n = 400_000
    zeros = pa.array(np.zeros(n))
    cols = columns(1) | {
        "loop": dictionary([0] * n, ["L0"]),
        "time": zeros,
        "sp": zeros,
        "pv": zeros,
        "op": zeros,
    }
    cols |= {f"x{k}": zeros for k in range(40)}
    bomb = frame(cols, compression="zstd")
    assert len(bomb) < 2**20
    before = pa.total_allocated_bytes()
    pool = pa.default_memory_pool()
    peak = pool.max_memory()
    tracemalloc.start()
    out, decoder = decode((FRAME, bomb))
    _, most = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert len(out) == 0
    assert refused(decoder) == {"too_large": 1}
    assert pa.total_allocated_bytes() == before
    assert pool.max_memory() == peak
    assert most < 2**20


def test_declared_lengths_are_believed_only_within_bounds():
    """A buffer that says it decompresses to a terabyte, rows that are not there: refused before allocation."""
    small = bytearray(frame(columns(1000), compression="zstd"))
    at = [k for k in range(len(small) - 8) if struct.unpack_from("<q", small, k)[0] == 8000]
    assert len(at) >= 3
    for k in at:
        struct.pack_into("<q", small, k, 2**40)
    _, decoder = decode((FRAME, bytes(small)))
    assert refused(decoder) == {"too_large": 1}
    many = bytearray(frame(columns(1000)))
    for k in range(len(many) - 8):
        if struct.unpack_from("<q", many, k)[0] == 1000:
            struct.pack_into("<q", many, k, 2**33)
    _, decoder = decode((FRAME, bytes(many)))
    assert refused(decoder) == {"too_large": 1}
