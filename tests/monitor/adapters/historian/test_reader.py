"""A file to samples: the same data give the same samples, and what is unusable says why."""

from __future__ import annotations

from pathlib import Path

import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from monitor.adapters.historian.merge import Span, in_order
from monitor.adapters.historian.reader import inspect, read, scan
from monitor.adapters.historian.rows import Tally, UnusableError
from monitor.adapters.historian.source import MOST_COLUMNS
from tests.monitor.adapters.historian.tools import (
    NAMES,
    WANTED,
    all_of,
    by_loop,
    equal,
    frame,
    load,
    samples_of,
    sources,
    wide,
    write,
)
from tests.support.samples import join


@pytest.mark.parametrize("time", ["timestamp", "text", "naive", "s", "ms", "us", "ns", "excel"])
@pytest.mark.parametrize("suffix", [".parquet", ".csv"])
@pytest.mark.parametrize("layout", ["long", "per loop", "wide"])
def test_same_data_give_same_samples(tmp_path: Path, layout: str, suffix: str, time: str) -> None:
    """Layout, format and the way of writing time change nothing; streaming equals sorting."""
    data = frame()
    if layout == "long":
        paths = [write(data, tmp_path / f"data{suffix}", time)]
    elif layout == "wide":
        paths = [write(wide(data), tmp_path / f"wide{suffix}", time)]
    else:
        paths = [
            write(p.drop(columns="loop"), tmp_path / f"{n}{suffix}", time) for n, p in data.groupby("loop")
        ]
    found = sources(*paths)
    assert {s.layout.kind for s in found} == {layout}
    tally = Tally()
    equal(load(found, WANTED, Span(), tally), samples_of(data))
    equal(by_loop(join(list(in_order(found, WANTED, Span(), Tally())))), samples_of(data))
    assert tally.rows == len(data)
    assert tally.loop_rows == dict.fromkeys(NAMES, 40)
    assert not tally.bad_time


@pytest.mark.parametrize(
    ("name", "content", "reason"),
    [
        ("d.csv", b"", "an empty file"),
        ("d.csv", b"loop,time,sp,pv,op\n", "no rows"),
        ("d.csv", b"a,b\n1,2\n", "columns a, b, expected columns `loop, time"),
        ("d.csv", b"loop,time,sp,pv\nx,1,2,3\n", "expected columns `loop, time"),
        ("d.csv", b"name,kp\nx,1\n", "a loop table, not data"),
        ("d.csv", b"loop,time,time,sp,pv,op\nx,1,2,3,4,5\n", "twice"),
        ("d.csv", b"loop,time,sp,pv,op\nx,noon,3,4,5\n", "time: 'noon', expected ISO text"),
        ("d.parquet", b"PAR1 this is none PAR1", ""),
        ("d.parquet", b"not a parquet file at all", ""),
        ("d.doc", b"x", "suffix '.doc', expected .parquet or .csv"),
        ("d.csv", b"x," * (MOST_COLUMNS + 1) + b"\n", f"{MOST_COLUMNS + 2} columns, expected at most"),
        ("d.csv", b"x" * (17 << 20), "a line of more than 16 MB"),
        ("d.csv", b"loop,time,sp,pv,op\nx,1,2,3," + b"4" * (17 << 20), "a line of more than 16 MB"),
    ],
)
def test_unusable_file_says_why_in_one_line(tmp_path: Path, name: str, content: bytes, reason: str) -> None:
    (tmp_path / name).write_bytes(content)
    with pytest.raises(UnusableError) as caught:
        inspect(tmp_path / name, name)
    assert str(caught.value).startswith(f"{name}: ")
    assert reason in str(caught.value)
    assert "\n" not in str(caught.value)


def test_missing_file_says_so(tmp_path: Path) -> None:
    with pytest.raises(UnusableError, match="No such file"):
        inspect(tmp_path / "none.csv")


@settings(max_examples=60)
@given(data=st.data())
def test_flipped_bytes_never_crash(tmp_path_factory: pytest.TempPathFactory, data: st.DataObject) -> None:
    """A damaged file is read, counted or refused; nothing else is raised."""
    folder = tmp_path_factory.mktemp("f")
    suffix = data.draw(st.sampled_from([".csv", ".parquet"]))
    path = write(frame(quality=False), folder / f"d{suffix}")
    content = bytearray(path.read_bytes())
    for at in data.draw(st.lists(st.integers(0, len(content) - 1), max_size=8)):
        content[at] = data.draw(st.integers(0, 255))
    path.write_bytes(content[: data.draw(st.integers(1, len(content)))])
    try:
        all_of(path)
    except UnusableError as error:
        assert "\n" not in str(error)  # noqa: PT017


HOSTILE = [
    "../../etc/x",
    "<script>alert(1)</script>",
    "=cmd()",
    "a/*/b",
    "\u202egnp.exe",
    "n" * 10_000,
    "[bold]x",
]


def test_names_are_data(tmp_path: Path) -> None:
    data = pd.concat([frame(5).assign(loop=name) for name in HOSTILE])
    (source,) = sources(write(data, tmp_path / "d.parquet"))
    assert set(scan(source)[0]) == set(HOSTILE)
    tally = Tally()
    list(read(source, {HOSTILE[2]: 0}, tally))
    assert tally.unknown == {n[:200] for n in HOSTILE if n != HOSTILE[2]}
    assert tally.rows == 10
