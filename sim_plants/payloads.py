"""Samples to the payloads of the wire: tag, sample and frame."""

import math
from collections.abc import Sequence

import msgspec
import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from sim_plants.loops import Block

FRAME_SCHEMA = pa.schema(
    [
        ("loop", pa.dictionary(pa.int32(), pa.string())),
        ("time", pa.timestamp("ns", tz="UTC")),
        ("sp", pa.float64()),
        ("pv", pa.float64()),
        ("op", pa.float64()),
        ("auto", pa.bool_()),
    ]
)
"""Columns of a frame, and of the long form of a historian export."""


class _Tag(msgspec.Struct):
    """Value and time of one quantity."""

    v: float
    t: str


class _Sample(msgspec.Struct, omit_defaults=True):
    """One sample of a loop; what is missing is left out."""

    t: str
    sp: float | None = None
    pv: float | None = None
    op: float | None = None
    auto: bool | None = None


_encode = msgspec.json.Encoder().encode


def iso_times(time_ns: NDArray[np.int64]) -> list[str]:
    """Return times [ns since 1970 UTC], shape `(N,)`, as ISO 8601 text with microseconds and Z."""
    stamps = time_ns.astype("datetime64[ns]")
    return [text + "Z" for text in np.datetime_as_string(stamps, unit="us").tolist()]


def encode_tag(value: float, time: str) -> bytes | None:
    """Return the JSON `{"v": …, "t": …}` of one quantity, None for a missing value (not finite)."""
    return _encode(_Tag(value, time)) if math.isfinite(value) else None


def _known(value: float) -> float | None:
    return value if math.isfinite(value) else None


def encode_sample(time: str, sp: float, pv: float, op: float, auto: bool) -> bytes:
    """Return the JSON of one sample; a missing value (not finite) is left out."""
    return _encode(_Sample(time, _known(sp), _known(pv), _known(op), auto))


def encode_frame(names: pa.Array, block: Block, seq: int) -> bytes:
    """Return samples of any number of loops as an Arrow IPC stream.

    Parameters
    ----------
    names : pyarrow.Array
        Names of all loops, to which `block.loop` points.
    block : Block
        The samples.
    seq : int
        Number of the frame in its stream; put into the schema's metadata as decimal text.
    """
    # Only the names that occur go along: a frame is read by itself.
    used, codes = np.unique(block.loop, return_inverse=True)
    schema = FRAME_SCHEMA.with_metadata({"seq": str(seq)})
    sink = pa.BufferOutputStream()
    with pa.ipc.new_stream(sink, schema) as stream:
        stream.write_batch(to_batch(block, codes.astype(np.int32), names.take(pa.array(used)), schema))
    return bytes(sink.getvalue().to_pybytes())


def to_batch(block: Block, codes: NDArray[np.int32], names: pa.Array, schema: pa.Schema) -> pa.RecordBatch:
    """Return samples as Arrow columns; `codes`, shape `(N,)`, point to the loops' `names`."""
    loop = pa.DictionaryArray.from_arrays(pa.array(codes), names)
    time = pa.array(block.time_ns).cast(FRAME_SCHEMA.field("time").type)
    values = [pa.array(column) for column in (block.sp, block.pv, block.op, block.auto)]
    return pa.record_batch([loop, time, *values], schema=schema)


def name_array(names: Sequence[str]) -> pa.Array:
    """Return names as `encode_frame` takes them."""
    return pa.array(names, pa.string())
