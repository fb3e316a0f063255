"""Single tags are joined as live tags are."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa
import pytest
from hypothesis import given
from hypothesis import strategies as st

from monitor.adapters.historian.clock import zone_of
from monitor.adapters.historian.reader import inspect
from monitor.adapters.historian.reading import settled
from monitor.adapters.historian.rows import Rows, Tally, join_rows
from monitor.adapters.historian.tall import (
    joined_rows,
    joined_series,
    mode_values,
    series_of,
    tag_codes,
    whole,
)

START = pd.Timestamp("2026-03-14T08:00:00Z")
TAGS = ("A.SP", "A.PV", "A.OP", "A.MODE")


def rows_of(path: Path, lines: list[tuple[float, str, str]]) -> Rows:
    text = [f"{(START + pd.Timedelta(seconds=t)).isoformat()},{tag},{value}" for t, tag, value in lines]
    path.write_text("\n".join(["time,tag,value", *text]) + "\n")
    [source] = settled([inspect(path, path.name)])
    return join_rows(list(joined_rows([source], {"A": 0}, {}, Tally())))


def naive_join(lines: list[tuple[float, str, str]]) -> list[tuple[float, ...]]:
    """Ten lines of plain Python: the latest good value of each other tag at each PV's time."""
    order = sorted(range(len(lines)), key=lambda k: (lines[k][0], k))
    out = []
    for k in order:
        t, tag, value = lines[k]
        if tag != "A.PV":
            continue
        held = []
        for other in ("A.SP", "A.OP"):
            good = [
                lines[j] for j in order if lines[j][1] == other and lines[j][0] <= t and lines[j][2] != "Bad"
            ]
            best = [g for g in good if g[0] == max(x[0] for x in good)]
            held.append(float(best[0][2]) if best else np.nan)
        out.append((t, held[0], np.nan if value == "Bad" else float(value), held[1]))
    return out


LINES = st.lists(
    st.tuples(
        st.integers(0, 30).map(float),
        st.sampled_from(TAGS[:3]),
        st.sampled_from(["1.5", "2.5", "-3.0", "Bad"]),
    ),
    max_size=30,
)


@given(lines=LINES)
def test_a_sample_at_each_pv_with_the_others_held(
    tmp_path_factory: pytest.TempPathFactory, lines: list
) -> None:
    """As the naive twin says, whatever the order and the stamps."""
    lines = [(0.0, tag, "1.0") for tag in TAGS[:3]] + lines
    found = rows_of(tmp_path_factory.mktemp("t") / "d.csv", lines)
    wanted = naive_join(lines)
    t = (found.time - START.value) / 1e9
    got = np.column_stack([t, found.sp, found.pv, found.op])
    assert np.array_equal(got, np.array(wanted).reshape(-1, 4), equal_nan=True)


def test_the_mode_is_held_and_unknown_before_its_first(tmp_path: Path) -> None:
    lines = [(0.0, "A.SP", "1"), (0.0, "A.OP", "1")] + [(float(t), "A.PV", "1") for t in range(4)]
    found = rows_of(tmp_path / "d.csv", [*lines, (1.0, "A.MODE", "MAN"), (2.5, "A.MODE", "CAS")])
    assert found.auto.tolist() == [-1, 0, 0, 1]
    assert rows_of(tmp_path / "e.csv", lines).auto.tolist() == [1] * 4


def test_a_night_when_clocks_go_back_is_told_apart_by_each_tags_order(tmp_path: Path) -> None:
    at = pd.date_range("2026-10-24T23:00Z", "2026-10-25T03:00Z", freq="10min")
    local = at.tz_convert("Europe/Berlin").strftime("%d-%b-%y %H:%M:%S")
    lines = [f"{t},A.{r},{k}" for r in ("SP", "PV", "OP") for k, t in enumerate(local)]
    (tmp_path / "d.csv").write_text("\n".join(["time,tag,value", *lines]))
    [source] = settled([inspect(tmp_path / "d.csv", "d")])
    [found] = joined_rows([source], {"A": 0}, {"d": zone_of("Europe/Berlin")}, Tally())
    assert found.time.tolist() == at.as_unit("ns").asi8.tolist()
    assert found.sp.tolist() == found.pv.tolist() == list(range(len(at)))


def test_bad_quality_holds_the_last_good_value(tmp_path: Path) -> None:
    rows = ["time,tag,value,quality"]
    for t, q in enumerate(("Good", "Bad")):
        rows += [f"2026-03-14T08:00:0{t}Z,A.{r},{t},{q if r != 'OP' else 'Good'}" for r in ("SP", "PV", "OP")]
    (tmp_path / "d.csv").write_text("\n".join(rows))
    [source] = settled([inspect(tmp_path / "d.csv", "d")])
    series = whole(list(series_of(source, {"A": 0}, Tally())))
    [found] = joined_series([(source, series)], {"A": 0}, {}, Tally())
    assert (found.sp.tolist(), found.op.tolist()) == ([0, 0], [0, 1])
    assert found.quality.tolist() == [192, 0]


def test_codes_of_one_column_and_of_two() -> None:
    batch = pa.RecordBatch.from_pydict({"loop": ["A", "B", "A"], "role": ["pv", "pv", None]})
    assert tag_codes(batch, ["loop", "role"], {"A.pv": 3, "B.pv": 5}).tolist() == [3, 5, -1]
    assert tag_codes(batch, ["loop"], {"A": 1}).tolist() == [1, -1, 1]


def test_modes_as_words_and_numbers() -> None:
    assert mode_values(pa.array(["AUTO", "MAN", "ODD", "Bad"]), Tally(), {})[:3].tolist() == [1, 0, 0]
    assert np.isnan(mode_values(pa.array([1.0, 0.0, 7.0]), Tally(), {})[2])
    assert mode_values(pa.array([7.0]), Tally(), {"7": 1}).tolist() == [1]
