"""Payloads: every row of the contract, and every way of getting one wrong."""

from __future__ import annotations

import json
import math
import random
import struct
import subprocess
import sys
import tracemalloc
import warnings
from typing import Any

import msgspec
import numpy as np
import pyarrow as pa
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from monitor.contract.entries import LARGEST, SAMPLE, TAG_AUTO, TAG_OP, TAG_PV, TAG_SP, UNKNOWN, Message
from monitor.contract.loops import Loop, LoopTable, default_key
from monitor.contract.quality import opc_quality
from monitor.contract.records import Event, LoopRow, Suggestion
from monitor.contract.samples import QUALITY_UNCERTAIN
from monitor.contract.times import iso, time_of
from monitor.wire.arrow_header import claim
from monitor.wire.decode import MOST_BATCHES, MOST_KEYS, MOST_ROWS, Decoder
from monitor.wire.encode import encode_record, to_json
from tests.support.places import ROOT

NOW = 1_795_341_600 * 10**9  # 2026-11-22T10:00:00Z
MINUTE = 60 * 10**9
NAN = math.nan
FRAME = "plant/area1/frame"


def table(n: int = 5) -> LoopTable:
    return LoopTable([Loop(name=f"L{k}") for k in range(n)])


def decode(*messages: tuple[str, bytes], decoder: Decoder | None = None, latest: int = NOW + MINUTE) -> Any:
    """Decode with warnings as errors; returns the entries and the decoder."""
    decoder = decoder or Decoder(table())
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        return decoder.decode([Message(key, payload, NOW) for key, payload in messages], latest), decoder


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


# ---------------------------------------------------------------------------------------------------
# tags


@pytest.mark.parametrize(
    ("key", "kind", "field"),
    [("sp", TAG_SP, "sp"), ("pv", TAG_PV, "pv"), ("op", TAG_OP, "op")],
)
@pytest.mark.parametrize(
    "payload", [b"12.5", b'{"v": 12.5}', b'{"v":12.5,"q":192,"t":"2026-11-22T10:00:00Z"}']
)
def test_a_tag_is_a_number_or_an_object(key, kind, field, payload):
    """A bare number, or v with time and quality; the time defaults to the message's."""
    out, decoder = decode((f"plant/L1/{key}", payload))
    assert out[["loop", "kind", "quality", "time"]].tolist() == [(1, kind, 192, NOW)]
    assert out[field][0] == 12.5
    assert sum(np.isnan(out[n][0]) for n in ("sp", "pv", "op")) == 2
    assert not refused(decoder)


@pytest.mark.parametrize(
    ("payload", "mode"),
    [
        (b"1", 1), (b"0", 0), (b"true", 1), (b"false", 0), (b'{"v": false}', 0), (b"2", 1),
        (b'"MAN"', UNKNOWN), (b"null", UNKNOWN), (b'{"v": "Bad Input"}', UNKNOWN), (b"{}", UNKNOWN),
    ],
)  # fmt: skip
def test_a_mode_that_cannot_be_read_is_none(payload, mode):
    """Numbers and booleans are modes; a text is not silently automatic."""
    out, _ = decode(("plant/L1/auto", payload))
    assert out[["kind", "auto"]].tolist() == [(TAG_AUTO, mode)]


@pytest.mark.parametrize(
    ("text", "time"),
    [
        ('"2026-11-22T10:00:00.250Z"', NOW + 250_000_000),
        ('"2026-11-22T11:00:00.25+01:00"', NOW + 250_000_000),
        ('"2026-11-22T10:00:00.250000"', NOW + 250_000_000),
        ("1795341600.25", NOW + 250_000_000),
        ("1795341600", NOW),
        ("null", NOW),
    ],
)
def test_times_of_tags_and_samples(text, time):
    """ISO text (naive is UTC), epoch seconds, or the message's own time."""
    out, _ = decode(
        ("plant/L1/pv", f'{{"v":1,"t":{text}}}'.encode()), ("plant/L1", f'{{"pv":1,"t":{text}}}'.encode())
    )
    assert out["time"].tolist() == [time, time]


@given(st.integers(0, 2**31))
def test_iso_and_back(seconds):
    """The time on the wire is the instant, to the microsecond, before and after 2038."""
    ns = seconds * 2 * 10**9 + 123_456_000
    assert time_of(iso(ns), 0) == ns
    assert abs(time_of(ns / 1e9, 0) - ns) <= 1000


# ---------------------------------------------------------------------------------------------------
# samples


def test_a_sample_is_an_object_under_the_loops_key():
    """All fields; what is left out is missing, auto true, quality good."""
    full = b'{"t":"2026-11-22T10:00:00Z","sp":1,"pv":2.5,"op":3,"auto":false,"q":64}'
    out, _ = decode(("plant/L2", full), ("plant/L2", b'{"pv":2.5}'))
    assert out[0].tolist() == (NOW, 2, SAMPLE, 0, 64, 1.0, 2.5, 3.0)
    assert out[["auto", "quality", "pv"]][1].tolist() == (1, 192, 2.5)
    assert np.isnan(out["sp"][1])
    assert np.isnan(out["op"][1])


@pytest.mark.parametrize("text", ["Bad Input", "I/O Timeout", "No Data", "#N/A", "", "12.5"])
def test_text_in_a_value_is_a_missing_value(text):
    """A gateway's words stand for no value, in a sample and in a tag; the message is not lost."""
    payload = json.dumps({"sp": 1, "pv": text, "op": 3}).encode()
    out, decoder = decode(("plant/L0", payload), ("plant/L0/pv", json.dumps(text).encode()))
    assert np.isnan(out["pv"]).all()
    assert not refused(decoder)


@pytest.mark.parametrize(
    ("code", "byte"),
    [(192, 192), (0, 0), (216, 216), (-5, 0), (0x4C0, 192), (0x4000_0000, 64), (0x8000_0000, 0), (1e30, 0)],
)
def test_quality_means_the_same_in_json_and_in_frames(code, byte):
    """An OPC code's byte, a vendor's upper byte left out; of an OPC UA status the top bits; negative is bad."""
    out, decoder = decode(
        ("plant/L0/pv", json.dumps({"v": 1, "q": code}).encode()),
        ("plant/L0", json.dumps({"pv": 1, "q": code}).encode()),
        (FRAME, frame(columns(1, quality=pa.array([float(code)])))),
    )
    assert out["quality"].tolist() == [byte] * 3
    assert not refused(decoder)


def test_quality_that_is_not_given_is_good():
    """Null and NaN are not given; so the audit reads an empty cell."""
    out, decoder = decode(
        ("plant/L0/pv", b'{"v":1,"q":null}'),
        (FRAME, frame(columns(2, quality=pa.array([None, NAN], pa.float64())))),
    )
    assert out["quality"].tolist() == [192, 192, 192]
    assert not refused(decoder)
    assert opc_quality(np.array([NAN, 70000.0])).tolist() == [192, 70000 & 0xFF]


@pytest.mark.parametrize(
    ("key", "payload"),
    [
        ("plant/L0", b""), ("plant/L0", b"5"), ("plant/L0", b"[]"), ("plant/L0", b'{"sp":true}'),
        ("plant/L0", b"\xff\xfe"),
        ("plant/L0", b'{"t":"23:59:60"}'), ("plant/L0", b'{"t":"2026-11-22T23:59:60Z"}'), ("plant/L0", b'{"t":"soon"}'),
        ("plant/L0", b'{"pv":{"a":[1]}}'), ("plant/L0", b'{"auto":"MAN"}'), ("plant/L0/pv", b"NaN"),
        ("plant/L0/pv", b"1e999"), ("plant/L0/pv", b"1" + b"0" * 400), ("plant/L0/pv", b"[" * 100_000),
        ("plant/L0/pv", b'{"v":' * 100_000), ("plant/L0/pv", b'{"v":1,"t":true}'), ("plant/L0/pv", b"Bad Input"),
        ("plant/L0/settings", b"[]"), ("plant/L0/settings", b'{"kp":0}'), ("plant/L0/settings", b'{"kp":[1]}'),
        ("plant/L0/settings", b'{"ti":-1}'), (FRAME, b""), (FRAME, b"\xff\xff\xff\xff"), (FRAME, b"x" * 1000),
    ],
)  # fmt: skip
def test_what_cannot_be_read_is_malformed(key, payload):
    """Counted once, said once for its key, and the next message is read."""
    out, decoder = decode((key, payload), (key, payload), ("plant/L1", b'{"pv":1}'))
    assert refused(decoder) == {"malformed": 2}
    assert len(out) == 1
    assert [r[:2] for r in decoder.refused] == [("malformed", key)]
    _, decoder = decode((key, payload), decoder=decoder)
    assert decoder.refused == []


@pytest.mark.parametrize(
    ("t", "cause"),
    [
        ("0", "bad_time"), ("-5", "bad_time"), ("86399", "bad_time"), ("1e300", "bad_time"), ("1e10", "bad_time"),
        ('"1900-01-01"', "bad_time"), ('"0001-01-01T00:00:00+23:59"', "bad_time"), ('"9999-12-31"', "bad_time"),
        (str(NOW // 10**9 + 61), "future"), (str(NOW // 10**9 + 60), None), ("4102444800", "future"),
    ],
)  # fmt: skip
def test_times_that_are_none_and_the_future(t, cause):
    """1970, 1900, beyond 2262: bad; more than a minute ahead: future. Each sample has exactly one cause."""
    messages = [("plant/L0", f'{{"pv":1,"t":{t}}}'.encode()), ("plant/L0/pv", f'{{"v":1,"t":{t}}}'.encode())]
    out, decoder = decode(*messages)
    assert refused(decoder) == ({} if cause is None else {cause: 2})
    assert len(out) == (2 if cause is None else 0)


# ---------------------------------------------------------------------------------------------------
# frames


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


def dictionary(codes: list[int | None], names: list[str | None], kind: Any = None) -> Any:
    return pa.DictionaryArray.from_arrays(pa.array(codes, kind or pa.int8()), pa.array(names, pa.string()))


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


# ---------------------------------------------------------------------------------------------------
# size


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


def test_large_payloads_rows_and_batches_are_refused():
    """By bytes, by rows, by the number of batches."""
    _, decoder = decode(("plant/L0", b" " * (LARGEST + 1)))
    assert refused(decoder) == {"too_large": 1}
    one = pa.array(np.ones(MOST_ROWS + 1), pa.float32())
    cols = {
        "loop": dictionary([0] * (MOST_ROWS + 1), ["L0"]),
        "time": one.cast(pa.int8()),
        "sp": one.cast(pa.int8()),
    }
    cols |= {"pv": one.cast(pa.int8()), "op": one.cast(pa.int8())}
    assert refused(decode((FRAME, frame(cols)))[1]) == {"too_large": 1}
    assert refused(decode((FRAME, frame(columns(1), times=MOST_BATCHES + 1)))[1]) == {"too_large": 1}
    assert len(decode((FRAME, frame(columns(1), times=MOST_BATCHES)))[0]) == MOST_BATCHES


def test_what_strangers_send_is_remembered_only_so_far():
    """Unknown names, keys with complaints and frame streams: each kept up to a bound, names cut."""
    decoder = Decoder(table())
    for k in range(0, 3 * MOST_KEYS, 1000):
        decode(*((f"plant/{j}/frame", b"x") for j in range(k, k + 1000)), decoder=decoder)
        decode(*((f"plant/{j}/{'y' * 1000}", b"{}") for j in range(k, k + 1000)), decoder=decoder)
    one = frame(columns(1))
    decode(*((f"plant/s{j}/frame", one) for j in range(MOST_KEYS + 50)), decoder=decoder)
    decode((FRAME, frame(columns(1, loop=pa.array(["n" * 1_000_000])))), decoder=decoder)
    assert refused(decoder) == {"malformed": 3 * MOST_KEYS, "unknown_loop": 3 * MOST_KEYS + 1}
    assert len(decoder.unknown) <= 100
    assert max(map(len, decoder.unknown)) <= 200
    assert len(decoder._complained) <= MOST_KEYS
    assert len(decoder._streams) <= MOST_KEYS


# ---------------------------------------------------------------------------------------------------
# fuzz: never an exception, and every payload is accounted for


def accounted(out: Any, decoder: Decoder, messages: int) -> None:
    assert len(decoder.causes) <= 7
    assert all(n > 0 for n in refused(decoder).values())
    if messages == 1:
        assert len(out) > 0 or sum(decoder.causes.values()) > 0
    assert ((out["loop"] >= 0) & (out["loop"] < len(decoder.loops))).all()
    assert np.isin(out["kind"], range(5)).all()


KEYS = st.sampled_from(
    [
        "plant/L0",
        "plant/L0/pv",
        "plant/L0/sp",
        "plant/L0/auto",
        "plant/L0/settings",
        "plant/x",
        FRAME,
        "frame",
        "sp",
        "",
    ]
)
JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=20),
    lambda inner: (
        st.lists(inner, max_size=3)
        | st.dictionaries(
            st.sampled_from(["v", "t", "q", "sp", "pv", "op", "auto", "kp", "ti", "form", "name"]),
            inner,
            max_size=6,
        )
    ),
    max_leaves=10,
)


@given(KEYS, st.binary(max_size=300))
@settings(max_examples=300, deadline=None)
def test_any_bytes(key, payload):
    """Random bytes under any key."""
    out, decoder = decode((key, payload))
    if key != "plant/L0/settings":
        accounted(out, decoder, 1)


@given(st.lists(st.tuples(KEYS, JSON), min_size=1, max_size=5))
@settings(max_examples=300, deadline=None)
def test_any_json(drawn):
    """JSON of any shape: each message is one entry, one cause, or settings."""
    messages = [(key, json.dumps(value).encode()) for key, value in drawn]
    out, decoder = decode(*messages)
    assert len(out) + sum(refused(decoder).values()) + len(decoder.settings) == len(messages)


def sources() -> list[bytes]:
    names = dictionary([k % 3 for k in range(20)], ["L0", "L1", "nobody"])
    views = pa.array([f"a long name of loop number {k}" for k in range(20)], pa.string_view())
    return [
        frame(columns(20)), frame(columns(20, loop=names), seq=5), frame(columns(20), compression="zstd"),
        frame(columns(20, loop=names), compression="lz4", times=2), frame(columns(20, loop=views)),
        frame(columns(20, more=pa.array([[1, 2], [3]] * 10), quality=pa.array(range(20)), auto=pa.array([True] * 20))),
    ]  # fmt: skip


FUZZ = """
import random, warnings
warnings.simplefilter("error")
from tests.monitor.wire.test_decode import damaged
damaged(random.Random({seed}), {count})
"""


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


@pytest.mark.parametrize(
    ("seed", "count"), [(1, 1500), pytest.param(2, 200_000, marks=pytest.mark.slow)], ids=["short", "long"]
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


@given(st.lists(st.sampled_from(range(8)), min_size=1, max_size=30), st.randoms(use_true_random=False))
@settings(max_examples=100, deadline=None)
def test_counters_add_up(kinds, rng):
    """Whatever comes in: every sample is in the output or in exactly one cause."""
    came = 0
    messages = []
    for kind in kinds:
        n = rng.randrange(1, 6)
        choices = [
            (1, ("plant/L0", b'{"pv":1,"sp":1,"op":1}')), (1, ("plant/nobody/pv", b"1")), (1, ("plant/L1/pv", b"{")),
            (1, ("plant/L1/pv", b'{"v":1,"t":5}')), (n, (FRAME, frame(columns(n)))),
            (n, (FRAME, frame(columns(n, loop=pa.array(["L0", "??", None, "L1", "L2"][:n]))))),
            (n, (FRAME, frame(columns(n, time=pa.array([NAN, NOW / 1e9, 1e12, NOW / 1e9 + 99, 0.0][:n]))))),
            (1, (FRAME, b"?")),
        ]  # fmt: skip
        samples, message = choices[kind]
        came += samples
        messages.append(message)
    out, decoder = decode(*messages)
    assert len(out) + sum(refused(decoder).values()) == came


# ---------------------------------------------------------------------------------------------------
# keys and settings


NAMES = [
    "../../etc/x",
    "<script>alert(1)</script>",
    "=cmd()",
    "a/*/b",
    "@x",
    "a$*b",
    "a?b=c#d",
    "%2F",
    "ü" * 100,
]


@pytest.mark.parametrize("name", NAMES)
def test_names_are_data(name):
    """A name with a meaning elsewhere has a key of its own, found by sample, tag, settings and frame."""
    loops = LoopTable([Loop(name="other"), Loop(name=name)])
    key = default_key(name)
    assert key.count("/") == 1
    decoder = Decoder(loops)
    messages = [
        (f"{key}/pv", b"1"),
        (f"{key}/settings", b'{"kp":2}'),
        (FRAME, frame(columns(1, loop=pa.array([name])))),
    ]
    messages.append((key, b'{"pv":1}'))
    out, _ = decode(*messages, decoder=decoder)
    assert out["loop"].tolist() == [1] * (len(messages) - 1)
    assert [(row, loop.name, loop.key, loop.kp) for row, loop in decoder.settings] == [(1, name, key, 2.0)]
    assert not refused(decoder)


def test_unknown_loops_are_counted_and_named():
    """By key or name, with how often."""
    out, decoder = decode(
        ("plant/x", b'{"pv":1}'), ("plant/x/pv", b"1"), ("plant/x/settings", b"{}"), ("plant/y", b"{}"),
        (FRAME, frame(columns(3, loop=pa.array(["x", "L0", "x"])))),
    )  # fmt: skip
    assert len(out) == 1
    assert refused(decoder) == {"unknown_loop": 6}
    assert decoder.unknown == {"plant/x": 3, "plant/y": 1, "x": 2}


def test_loops_register_by_key_and_by_name():
    """A key gives the name, decoded; a frame's name has the default key; settings and rubbish register nobody."""
    asked: list[tuple[str, str]] = []
    decoder = Decoder(table(0), register=lambda name, key: asked.append((name, key)))
    decode(
        ("plant/a%2Fb", b'{"pv":1}'), ("plant/area/c/pv", b"1"), ("plant/d/settings", b"{}"), ("plant/e/pv", b"{"),
        ("plant/f", b"5"), (FRAME, frame(columns(2, loop=pa.array(["g", None])))),
        decoder=decoder,
    )  # fmt: skip
    assert asked == [("a/b", "plant/a%2Fb"), ("area/c", "plant/area/c"), ("g", "")]


def test_settings_change_what_they_name():
    """Columns of the loop table; name, key and the rest stay, ki and kd in the parallel form."""
    loops = LoopTable(
        [Loop(name="P", form="parallel", kp=2.0, ti=10.0), Loop(name="S", kp=1.0, ti=5.0, td=2.0, ms_max=3.0)]
    )
    decoder = Decoder(loops)
    decode(
        ("plant/P/settings", b'{"kp":4,"ki":0.5}'),
        ("plant/S/settings", b'{"ti":null,"name":"X","key":"y"}'),
        decoder=decoder,
    )
    (_, first), (_, second) = decoder.settings
    assert (first.kp, first.ti) == (4.0, 8.0)
    assert (second.name, second.key, second.kp, second.ti, second.td, second.ms_max) == (
        "S",
        "plant/S",
        1.0,
        math.inf,
        2.0,
        3.0,
    )
    decode(decoder=decoder)
    assert decoder.settings == []


# ---------------------------------------------------------------------------------------------------
# out


def test_records_hold_no_nan_and_times_with_z():
    """Every record: schema, null for NaN and infinity, ISO times with Z."""

    def strict(data: bytes) -> Any:
        return json.loads(data, parse_constant=pytest.fail)

    event = Event(id="i", loop="<b>", kind="setpoint", state="open", start=NOW, end=None, amplitude=NAN)
    row = LoopRow(loop="x", new_ti=math.inf, ms=NAN, flags=("manual",))
    said = strict(encode_record(event))
    assert said == {
        "schema": 1, "id": "i", "loop": "<b>", "kind": "setpoint", "state": "open",
        "start": "2026-11-22T10:00:00.000000Z",
        "end": None, "amplitude": None,
    }  # fmt: skip
    said = strict(encode_record(Suggestion(row=row, evidence=("a", "b"))))
    assert (said["new_ti"], said["ms"], said["flags"], said["evidence"]) == (
        None,
        None,
        ["manual"],
        ["a", "b"],
    )
    said = strict(to_json({"a": {"b": NAN}, "c": [NAN, {"d": math.inf}]}))
    assert said == {"schema": 1, "a": {"b": None}, "c": [None, {"d": None}]}


def test_numpys_numbers_are_numbers():
    """A figure that came out of NumPy encodes like any other, and its NaN is null."""
    row = LoopRow(loop="L", noise=np.float64(0.5), offset=np.float64(NAN))
    found = json.loads(encode_record(row))
    assert (found["noise"], found["offset"]) == (0.5, None)


def test_uncertain_is_below_good():
    """The codes of the samples and of the wire are the same."""
    assert opc_quality(np.array([0x4000_0000]))[0] == QUALITY_UNCERTAIN
