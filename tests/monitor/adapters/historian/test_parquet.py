"""Parquet: row groups by themselves, names as dictionary or number."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq

from monitor.adapters.historian.merge import Span, in_order
from monitor.adapters.historian.reader import read, scan
from monitor.adapters.historian.rows import Tally
from tests.monitor.adapters.historian.tools import (
    NAMES,
    WANTED,
    all_of,
    equal,
    frame,
    load,
    samples_of,
    sources,
    write,
)
from tests.support.samples import join


def test_loop_column_as_dictionary_or_number(tmp_path: Path) -> None:
    data = frame()
    equal(all_of(write(data.astype({"loop": "category"}), tmp_path / "d.parquet")), samples_of(data))
    numbered = data.assign(loop=data["loop"].map(NAMES.index))
    found = sources(write(numbered, tmp_path / "n.parquet"))
    assert set().union(*scan(found[0])) == {"0", "1"}
    equal(load(found, {"0": 0, "1": 1}, Span(), Tally()), samples_of(data))


def test_row_groups_can_be_read_by_themselves(tmp_path: Path) -> None:
    data = frame().sort_values(["loop", "time"], ascending=[False, True])
    table = pa.Table.from_pandas(data.assign(time=pd.to_datetime(data["time"])), preserve_index=False)
    pq.write_table(table, tmp_path / "d.parquet", row_group_size=10)
    (source,) = sources(tmp_path / "d.parquet")
    groups = [g for g, found in enumerate(scan(source)) if NAMES[1] in found]
    assert groups == [4, 5, 6, 7]
    rows = list(read(source, WANTED, Tally(), [0, 1, 6]))
    assert [r.row + k for r in rows for k in range(len(r))] == [*range(20), *range(60, 70)]
    got = join(list(in_order([source], {NAMES[1]: 0}, Span(), Tally(), {"d.parquet": groups})))
    equal(replace(got, loop=got.loop + 1), samples_of(data[data["loop"] == NAMES[1]]))
