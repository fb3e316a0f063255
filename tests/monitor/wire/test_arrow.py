"""Frames: every form of a column, and what refuses a frame or a row."""

from __future__ import annotations

import subprocess
import sys
from typing import Any

import msgspec
import numpy as np
import pyarrow as pa
import pytest

from monitor.contract.loops import Loop
from monitor.wire.arrow_header import claim
from monitor.wire.decode import Decoder
from tests.monitor.wire.tools import (
    FRAME,
    NAN,
    NOW,
    columns,
    decode,
    dictionary,
    frame,
    refused,
    sources,
    table,
)
from tests.support.places import ROOT


def as_float32(values: list[float]) -> Any:
    return pa.array(values, pa.float32())


@pytest.mark.parametrize(
    "loops",
    [
        pa.array(["L2", "L0", "L2"]), pa.array(["L2", "L0", "L2"], pa.large_string()),
        pa.array(["L2", "L0", "L2"], pa.string_view()), pa.array(["L2", "L0", "L2"]).dictionary_encode(),
        pa.DictionaryArray.from_arrays(pa.array([127, 0, 127], pa.int8()), pa.array(["L0", *"a" * 126, "L2"])),
        pa.DictionaryArray.from_arrays(pa.array([1, 0, 1], pa.uint64()), pa.array(["L0", "L2"], pa.large_string())),
    ],
    ids=["string", "large", "view", "dictionary", "int8-full", "uint64"],
)  # fmt: skip
@pytest.mark.parametrize("number", [pa.array, as_float32], ids=["float64", "float32"])
@pytest.mark.parametrize("compression", [None, "zstd", "lz4"])
def test_a_frame_in_every_form(loops, number, compression):
    """Names as text or dictionary of any width, floats of both sizes, compressed or not."""
    cols = columns(loop=loops, pv=number([1.5, 2.5, 3.5]), auto=pa.array([True, False, None]))
    out, decoder = decode((FRAME, frame(cols, compression=compression)))
    assert out["loop"].tolist() == [2, 0, 2]
    assert out["pv"].tolist() == [1.5, 2.5, 3.5]
    assert out["auto"].tolist() == [1, 0, 1]
    assert (out["quality"] == 192).all()
    assert not refused(decoder)


@pytest.mark.parametrize(
    "stamps",
    [
        *(pa.array([NOW // f]).cast(pa.timestamp(u, z))
        for u, f in (("ns", 1), ("us", 10**3), ("ms", 10**6), ("s", 10**9))
          for z in (None, "UTC", "Europe/Berlin")),
        pa.array([NOW / 1e9]), pa.array([NOW // 10**9]),
    ],
)  # fmt: skip
def test_times_of_a_frame(stamps):
    """Timestamps of any unit, with a zone or without, float or whole seconds: the same instant."""
    out, _ = decode((FRAME, frame(columns(1, time=stamps))))
    assert out["time"].tolist() == [NOW]


def test_one_bad_row_does_not_cost_the_frame():
    """NaN or absurd times, nulls, unknown loops: each row its own cause, the others are used."""
    cols = columns(
        7,
        loop=pa.array(["L0", "L1", "nobody", None, "L2", "L3", "L4"]),
        time=pa.array([NOW / 1e9, NAN, NOW / 1e9, NOW / 1e9, 1e300, None, NOW / 1e9 + 3600]),
        pv=pa.array([None, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0]),
    )
    out, decoder = decode((FRAME, frame(cols)))
    assert out["loop"].tolist() == [0]
    assert np.isnan(out["pv"][0])
    assert refused(decoder) == {"bad_time": 3, "unknown_loop": 2, "future": 1}
    assert decoder.unknown == {"nobody": 1, "": 1}
    out, decoder = decode(
        (FRAME, frame(columns(2, time=pa.array([NOW // 10**9, 10**12]).cast(pa.timestamp("s")))))
    )
    assert len(out) == 1
    assert refused(decoder) == {"bad_time": 1}


def test_codes_that_are_null_name_no_loop():
    """A null code, and a name that is null, are unknown loops; the rows beside them count."""
    for loops in (dictionary([0, None, 1], ["L0", "L1"]), dictionary([0, 2, 1], ["L0", "L1", None])):
        out, decoder = decode((FRAME, frame(columns(loop=loops))))
        assert out["loop"].tolist() == [0, 1]
        assert refused(decoder) == {"unknown_loop": 1}


@pytest.mark.parametrize(
    "wrong",
    [
        {"loop": pa.array([1, 2, 3])}, {"loop": pa.nulls(3)}, {"loop": pa.array([b"a", b"b", b"c"])},
        {"loop": pa.DictionaryArray.from_arrays(pa.array([0, 0, 0]), pa.array([5]))},
        {"loop": pa.RunEndEncodedArray.from_arrays(pa.array([3], pa.int32()), pa.array(["L0"]))},
        {"time": pa.array(["a", "b", "c"])}, {"time": pa.array([1, 2, 3]).cast(pa.duration("s"))},
        {"time": pa.nulls(3)},
        {"sp": pa.array(["1", "2", "3"])}, {"pv": pa.array([[1.0]] * 3)}, {"op": pa.nulls(3)},
        {"pv": pa.array([True] * 3)},
        {"auto": pa.array(["a", "b", "c"])}, {"quality": pa.array(["good"] * 3)}, {"quality": pa.array([True] * 3)},
    ],
    ids=lambda w: next(f"{k}-{v.type}" for k, v in w.items()),
)  # fmt: skip
def test_a_column_of_another_type_refuses_the_frame(wrong):
    """The whole frame, once."""
    out, decoder = decode((FRAME, frame(columns(**wrong))))
    assert len(out) == 0
    assert refused(decoder) == {"malformed": 1}


def test_columns_missing_or_twice():
    """The five are needed, each once; columns that we do not know are left alone."""
    for name in ("loop", "time", "sp", "pv", "op"):
        cols = columns()
        del cols[name]
        assert refused(decode((FRAME, frame(cols)))[1]) == {"malformed": 1}
    batch = pa.record_batch([*columns().values(), pa.array([1.0, 2.0, 3.0])], names=[*columns(), "pv"])
    sink = pa.BufferOutputStream()
    with pa.ipc.new_stream(sink, batch.schema) as stream:
        stream.write_batch(batch)
    assert refused(decode((FRAME, sink.getvalue().to_pybytes()))[1]) == {"malformed": 1}
    more = columns(unit=pa.array([["%"], None, []]), note=pa.array([{"a": 1}] * 3))
    out, decoder = decode((FRAME, frame({"x": pa.nulls(3), **more})))
    assert len(out) == 3
    assert not refused(decoder)


def test_numbers_of_frames():
    """A gap is counted, a repeat dropped, a restart accepted, even where it comes no further than before."""
    decoder = Decoder(table())

    def send(seq: int, at: int = 0) -> int:
        times = pa.array([NOW + at * 10**9]).cast(pa.timestamp("ns"))
        return len(decode((FRAME, frame(columns(1, time=times), seq=seq)), decoder=decoder)[0])

    assert [send(0, 0), send(1, 1), send(4, 2)] == [1, 1, 1]
    assert refused(decoder) == {"missed_frames": 2}
    assert send(4, 2) == 0
    assert refused(decoder) == {"missed_frames": 2, "repeated_frames": 1}
    assert [send(0, 10), send(1, 11)] == [1, 1]  # begins anew
    assert [send(0, 20), send(0, 21)] == [1, 1]  # and again, twice after one frame
    assert [send(-3, 22), send(2**63, 23), send(0, 24), send(2**62, 25)] == [1, 1, 1, 1]
    assert refused(decoder) == {"missed_frames": 2, "repeated_frames": 1}
    other = decode(("plant/area2/frame", frame(columns(1), seq=77)), decoder=decoder)[0]
    assert len(other) == 1
    msgspec.json.encode(dict(decoder.causes))


@pytest.mark.parametrize("seq", ["abc", "9" * 4000, "1.5", ""])
def test_a_number_that_is_none_refuses_the_frame_before_it_counts_anything(seq):
    """Malformed, once; its unknown loops are not counted a second time."""
    _, decoder = decode((FRAME, frame(columns(loop=pa.array(["x", "y", "z"])), seq=seq)))
    assert refused(decoder) == {"malformed": 1}


def test_a_dropped_repeat_counts_its_loops_once():
    """Unknown loops of a repeated frame were counted with the first."""
    same = frame(columns(loop=pa.array(["x", "y", "z"])), seq=1)
    _, decoder = decode((FRAME, same), (FRAME, same))
    assert refused(decoder) == {"unknown_loop": 3, "repeated_frames": 1}


def test_names_are_looked_up_anew_when_they_or_the_table_change():
    """Frames whose dictionaries repeat, change, or name a loop that is added later."""
    loops = table(2)
    decoder = Decoder(loops)

    def rows(names: list[str]) -> list[int]:
        cols = columns(2, loop=pa.array(names).dictionary_encode())
        return [int(r) for r in decode((FRAME, frame(cols)), decoder=decoder)[0]["loop"]]

    assert rows(["L0", "L1"]) == [0, 1]
    assert rows(["L0", "L1"]) == [0, 1]
    assert rows(["L1", "L0"]) == [1, 0]
    assert rows(["L1", "new"]) == [1]
    loops.add(Loop(name="new"))
    assert rows(["L1", "new"]) == [1, 2]


def test_a_large_dictionary_of_which_little_is_used():
    """Names that no row uses are neither looked up nor registered nor counted, also when they are used later."""
    asked: list[str] = []
    decoder = Decoder(table(), register=lambda name, _: asked.append(name))
    names = ["L0", *(f"x{k}" for k in range(10_000))]
    for codes, found in (([0, 0, 5], 2), ([0, 7, 0], 2)):
        out, _ = decode((FRAME, frame(columns(loop=dictionary(codes, names, pa.int32())))), decoder=decoder)
        assert len(out) == found
    assert asked == ["x4", "x6"]
    assert decoder.unknown == {"x4": 1, "x6": 1}


FUZZ = """
import random, warnings
warnings.simplefilter("error")
from tests.monitor.wire.tools import damaged
damaged(random.Random({seed}), {count})
"""


@pytest.mark.parametrize(
    ("seed", "count"), [(1, 1500), pytest.param(2, 200_000, marks=pytest.mark.soak)], ids=["short", "long"]
)
def test_damaged_frames(seed, count):
    """Bits flipped, lengths forged, streams cut: no exception, and no crash of the process that reads them."""
    code = FUZZ.format(seed=seed, count=count)
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[-2000:]


@pytest.mark.parametrize("source", range(6))
def test_frames_cut_anywhere(source):
    """A stream that ends early is malformed, at whatever byte, but for a missing end mark."""
    whole = sources()[source]
    seen = 0
    for at in range(0, len(whole) - 8, 7):
        out, decoder = decode((FRAME, whole[:at]))
        seen = max(seen, len(out))
        assert len(out) or refused(decoder), at
    assert claim(whole).rows in {20, 40}
