"""Payloads: every row of the contract, and every way of getting one wrong."""

from __future__ import annotations

import json
import math

import numpy as np
import pyarrow as pa
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from monitor.contract.entries import (
    MODE_UNKNOWN,
    MOST_PAYLOAD_BYTES,
    SAMPLE,
    TAG_AUTO,
    TAG_OP,
    TAG_PV,
    TAG_SP,
    Message,
)
from monitor.contract.loops import Loop, LoopTable, default_key
from monitor.wire.decode import MOST_FRAME_BATCHES, MOST_FRAME_ROWS, MOST_KEYS, Decoder
from tests.monitor.wire.tools import (
    FRAME,
    NAN,
    NOW,
    accounted,
    columns,
    decode,
    decode_all,
    dictionary,
    frame,
    refused,
    table,
)

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
        (b'"MAN"', MODE_UNKNOWN), (b"null", MODE_UNKNOWN), (b'{"v": "Bad Input"}', MODE_UNKNOWN), (b"{}", MODE_UNKNOWN),
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


def test_times_that_are_refused_are_said_once():
    """With the first loop and its time: a replay whose times count from zero is no riddle."""
    messages = [("plant/L1", b'{"pv":1,"t":0}'), ("plant/L2", b'{"pv":1,"t":4102444800}')]
    _, decoder = decode(*messages)
    said = {(cause, name): why for cause, name, why in decoder.refused}
    assert said["bad_time", "L1"].startswith("0.000 s since 1970 is no time from 2 January 1970 on")
    assert "ahead of this machine's clock" in said["future", "L2"]
    decode(*messages, decoder=decoder)
    assert not decoder.refused
    assert refused(decoder) == {"bad_time": 2, "future": 2}


def test_large_payloads_rows_and_batches_are_refused():
    """By bytes, by rows, by the number of batches."""
    _, decoder = decode(("plant/L0", b" " * (MOST_PAYLOAD_BYTES + 1)))
    assert refused(decoder) == {"too_large": 1}
    one = pa.array(np.ones(MOST_FRAME_ROWS + 1), pa.float32())
    cols = {
        "loop": dictionary([0] * (MOST_FRAME_ROWS + 1), ["L0"]),
        "time": one.cast(pa.int8()),
        "sp": one.cast(pa.int8()),
    }
    cols |= {"pv": one.cast(pa.int8()), "op": one.cast(pa.int8())}
    assert refused(decode((FRAME, frame(cols)))[1]) == {"too_large": 1}
    assert refused(decode((FRAME, frame(columns(1), times=MOST_FRAME_BATCHES + 1)))[1]) == {"too_large": 1}
    assert len(decode((FRAME, frame(columns(1), times=MOST_FRAME_BATCHES)))[0]) == MOST_FRAME_BATCHES


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
@settings(max_examples=300)
def test_any_bytes(key, payload):
    """Random bytes under any key."""
    out, decoder = decode((key, payload))
    if key != "plant/L0/settings":
        accounted(out, decoder, 1)


@given(st.lists(st.tuples(KEYS, JSON), min_size=1, max_size=5))
@settings(max_examples=300)
def test_any_json(drawn):
    """JSON of any shape: each message is one entry, one cause, or settings."""
    messages = [(key, json.dumps(value).encode()) for key, value in drawn]
    decoder = Decoder(table())
    out, told = decode_all(decoder, *messages)
    assert len(out) + sum(refused(decoder).values()) + len(told) == len(messages)


@given(st.lists(st.sampled_from(range(8)), min_size=1, max_size=30), st.randoms(use_true_random=False))
@settings(max_examples=100)
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
    out, told = decode_all(decoder, *messages)
    assert out["loop"].tolist() == [1] * (len(messages) - 1)
    assert [(row, loop.name, loop.key, loop.kp) for row, loop in told] == [(1, name, key, 2.0)]
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
    _, ((_, first), (_, second)) = decode_all(
        decoder,
        ("plant/P/settings", b'{"kp":4,"ki":0.5}'),
        ("plant/S/settings", b'{"ti":null,"name":"X","key":"y"}'),
    )
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
    assert decoder.settings is None


def test_what_follows_settings_is_left_to_be_decoded_after_them():
    """A reader acts on them in between: the second ones rest on the first, and samples on either side know theirs."""
    loops = table()
    decoder = Decoder(loops)
    rest = iter(
        Message(key, payload, NOW)
        for key, payload in [
            ("plant/L0/pv", b"1"), ("plant/L0/settings", b'{"kp":4}'),
            ("plant/L0/pv", b"2"), ("plant/L0/settings", b'{"ti":9}'), ("plant/L0/pv", b"3"),
        ]
    )  # fmt: skip
    seen = []
    for _ in range(3):
        out = decoder.decode(rest, NOW)
        if decoder.settings is not None:
            loops.replace(*decoder.settings)
        seen.append((out["pv"].tolist(), loops[0].kp, loops[0].ti))
    assert seen == [([1.0], 4.0, math.inf), ([2.0], 4.0, 9.0), ([3.0], 4.0, 9.0)]


def test_what_is_remembered_of_streams_is_bounded(monkeypatch):
    """Frames under ever new keys: their names are forgotten in turn, and every sample finds its loop all the same."""
    payload = frame()
    monkeypatch.setattr("monitor.wire.decode.REMEMBERED_BYTES", 10 * len(payload))
    decoder = Decoder(table())
    for k in range(100):
        out, _ = decode((f"plant/{k}/frame", payload), decoder=decoder)
        assert out["loop"].tolist() == [0, 1, 2]
        assert sum(stream.names is not None for stream in decoder._streams.values()) <= 11
    assert not refused(decoder)
