"""Rows 1 to 8 of the bad-data matrix: values that are none, and what quality says."""

from __future__ import annotations

import logging
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from monitor.audit.run import run_audit
from monitor.audit.settings import AuditSettings
from monitor.contract.records import GOOD, NOT_ASSESSED
from tests.bad_data.harness import (
    LOST,
    NAME,
    SECOND,
    SETTINGS,
    START,
    Live,
    audit,
    both,
    good,
    live,
    messages,
    same,
    text,
)

N = 700
TOLD = ["Bad Input", "I/O Timeout", "No Data", "#N/A", "Pt Created", "Shutdown", ""]


def spoilt(column: str, *rows: int) -> pd.DataFrame:
    data = good(N)
    data.loc[list(rows), column] = np.nan
    return data


def alike(found, clean, iae: float = 0.01) -> None:
    """The same event, of about the same size, and the same verdict."""
    assert (found.event.id, found.event.kind, found.event.state) == (
        clean.event.id,
        "setpoint",
        "settled",
    )
    assert found.event.iae == pytest.approx(clean.event.iae, rel=iae)
    assert found.row.gain == pytest.approx(clean.row.gain, rel=0.02)
    assert found.row.verdict == clean.row.verdict


@pytest.mark.parametrize("at", [100, 306])
def test_one_missing_pv(clean, tmp_path: Path, at: int) -> None:
    """One PV that is no number, at rest or in the step's response: bad, bridged by its neighbours, not covered."""
    found = both(spoilt("pv", at), tmp_path)
    found.counted(ok=N - 1, bad_value=1)
    alike(found, clean)
    assert found.row.coverage < clean.row.coverage
    if at > 300:
        assert found.event.coverage < clean.event.coverage


def test_a_hole_wider_than_three_periods_is_not_integrated_across(clean, tmp_path: Path) -> None:
    """Six PVs missing in the middle of the response: that span is in no integral, and coverage says so."""
    found = both(spoilt("pv", *range(315, 321)), tmp_path)
    found.counted(ok=N - 6, bad_value=6)
    assert found.row.coverage < 1 - 5 / N
    first = found.events[0]
    assert first.iae < clean.event.iae
    assert first.state == "interrupted" or first.coverage < 0.99


@pytest.mark.parametrize("column", ["sp", "op"])
def test_only_the_set_point_or_only_the_output_is_missing(clean, tmp_path: Path, column: str) -> None:
    """What needs the missing one is left out, the rest goes on: the event, its size and the verdict are as without."""
    found = both(spoilt(column, 50, 100, 101, 200, 330), tmp_path)
    assert found.event.id == clean.event.id
    alike(found, clean, 0.02)


@pytest.mark.parametrize("value", [np.inf, -np.inf, 1e38, -1e38, 1e30])
def test_numbers_that_no_plant_has(clean, tmp_path: Path, value: float) -> None:
    """Infinite or absurdly large: a bad sample; nothing that is measured takes harm."""
    data = good(N)
    data.loc[[100, 320], "pv"] = value
    data.loc[200, "op"] = value
    found = both(data, tmp_path, payloads=("frame",))
    assert found.counts["bad_value"] >= 2
    alike(found, clean)
    assert found.row.noise == pytest.approx(clean.row.noise, rel=0.05)


def test_ten_ranges_outside_is_no_value(clean, tmp_path: Path) -> None:
    """With a known range, what lies more than ten ranges outside is bad; what lies within is a value."""
    data = good(N)
    data.loc[100, "pv"] = 1101.0
    table = [{**SETTINGS, "pv_low": 0.0, "pv_high": 100.0}]
    found = both(data, tmp_path, table=table)
    found.counted(ok=N - 1, bad_value=1)
    alike(found, clean)
    both(data, tmp_path / "unknown").counted(ok=N)


@pytest.mark.parametrize("value", [-0.0, 5e-324, 1e-310])
def test_numbers_at_the_edge_of_zero_are_values(tmp_path: Path, value: float) -> None:
    """A negative zero or a subnormal number is a value like any other, and no figure becomes infinite."""
    data = good(N).assign(sp=lambda d: d.sp - 50.0, pv=lambda d: d.pv - 50.0)
    data.loc[[100, 101, 150], "pv"] = value
    data.loc[:299, "sp"] = value
    found = both(data, tmp_path)
    found.counted(ok=N)
    assert (found.states, found.row.verdict) == (["settled"], GOOD)
    assert np.isfinite([found.row.noise, found.row.offset, found.event.iae]).all()


@pytest.mark.parametrize("told", TOLD)
def test_a_historians_words_in_place_of_a_value(clean, tmp_path: Path, told: str) -> None:
    """Text where a number should be: a bad sample; the column stays numbers; the words are kept for the reader."""
    found = both(text(good(N), "pv", [100, 101, 320], told), tmp_path)
    found.counted(ok=N - 3, bad_value=3)
    alike(found, clean)
    kept = found.about["text_in_values"]
    assert kept == {"count": 3, "most_frequent": {told: 3}}


def test_words_of_quality_are_kept(clean, tmp_path: Path) -> None:
    """A historian's words and codes mean the same live and in the audit; what was not good is kept as it stood."""
    data = good(N).assign(quality="Good").astype({"quality": object})
    for row, told in {100: "Bad", 101: "Bad Input", 320: "Uncertain", 321: "Questionable", 400: "24"}.items():
        data.loc[row, "quality"] = told
    found = both(data, tmp_path, payloads=("sample", "tag"))
    found.counted(ok=N - 3, bad_quality=3, uncertain=2)
    alike(found, clean)
    assert found.about["quality_not_good"] == dict.fromkeys(
        ("24", "Bad", "Bad Input", "Questionable", "Uncertain"), 1
    )


@pytest.mark.parametrize(
    ("values", "qualities", "said"),
    [
        (N, 0, f"all {N} samples were bad (no number, or out of range)"),
        (0, N, f"all {N} samples were bad (quality)"),
        (100, N, f"all {N} samples were bad (quality)"),
        (N, 100, f"all {N} samples were bad (most: no number, or out of range)"),
        (None, None, "no sample was seen"),
    ],
)
def test_nothing_but_bad_samples(tmp_path: Path, values: Any, qualities: Any, said: str) -> None:
    """A loop without one good sample: not assessed, and why; no figure; the other loop is not concerned."""
    bad = good(N, name="FIC-2").assign(quality=192)
    bad.loc[: (values or 0) - 1, "pv"] = np.nan
    bad.loc[: (qualities or 0) - 1, "quality"] = 0
    parts = [good(N).assign(quality=192), *([] if values is None else [bad])]
    data = pd.concat(parts).sort_values("time", kind="stable", ignore_index=True)
    found = both(data, tmp_path, table=[SETTINGS, {"name": "FIC-2"}])
    row = found.rows["FIC-2"]
    assert (row.verdict, row.reason) == (NOT_ASSESSED, f"no data: {said}")
    assert (row.ci_setpoint, row.coverage, row.noise, row.events) == (None, None, None, 0)
    assert found.rows[NAME].verdict == GOOD
    result = run_audit(
        [tmp_path / "audit" / "data.csv"], None, tmp_path / "x", AuditSettings(since="2027-01-01")
    )
    assert result.exit_code == 2


def test_bad_for_a_while_is_said_once_and_once_when_it_ends(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """Ten minutes of bad samples of one loop of two: a line on entry, one on exit, no event, no storm."""
    table = [SETTINGS, {"name": "FIC-2"}]
    other = good(900, name="FIC-2", size=0.0)
    mine = good(900, at=850)
    mine.loc[200:799, "pv"] = np.nan
    data = pd.concat([mine, other]).sort_values("time", kind="stable", ignore_index=True)
    with caplog.at_level(logging.WARNING, "loopsight"):
        found = live(data, tmp_path, table=table, every=1.0)
    lines = [r.getMessage() for r in caplog.records]
    assert lines == [f"only bad samples: {NAME}", f"heard again: {NAME}"]
    assert {e.loop for e in found.opened} == {NAME}
    assert all(e.start >= (START + 850) * SECOND for e in found.opened)
    same(audit(data, tmp_path / "a", table=table), found)


@pytest.mark.parametrize("value", [np.nan, 1e35])
def test_bad_from_some_time_to_the_end_is_said_in_the_row(tmp_path: Path, value: float) -> None:
    """Good for an hour, then bad for five: stale, and since when; what was found before stays."""
    table = [SETTINGS, {"name": "FIC-2"}]
    mine, other = (
        good(2000, at=200, period=10.0, kp=1.4, ti=600.0),
        good(2000, name="FIC-2", size=0.0, period=10.0, kp=1.4, ti=600.0),
    )
    table[0] = {**SETTINGS, "kp": 1.4, "ti": 600.0}
    mine.loc[360:, "pv"] = value
    data = pd.concat([mine, other]).sort_values("time", kind="stable", ignore_index=True)
    found = both(data, tmp_path, table=table, payloads=("frame",))
    assert "stale" in found.rows[NAME].flags
    assert found.rows[NAME].reason.endswith(
        "nothing but bad samples (1640) since Thursday 2026-01-01, 00:59 UTC"
    )
    assert found.rows[NAME].events == 1
    assert "stale" not in found.rows["FIC-2"].flags


def test_bad_from_the_start_is_said_once(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    """A loop that has never sent a good sample is named once, and once when one comes."""
    monitor = Live(tmp_path, [{**SETTINGS, "period": 1.0}, {"name": "FIC-2"}])
    mine, other = good(100).assign(pv=np.nan), good(100, name="FIC-2", size=0.0)
    mine.loc[80:, "pv"] = 50.0
    with caplog.at_level(logging.WARNING, "loopsight"):
        for a, b in zip(messages(mine), messages(other), strict=True):
            monitor.put([*a, *b], 1.0)
            assert monitor.status()["ready"]
    monitor.close()
    assert [r.getMessage() for r in caplog.records] == [f"only bad samples: {NAME}", f"heard again: {NAME}"]


@pytest.mark.parametrize("code", [0, 4, 24, 63])
def test_bad_quality_wins_over_a_plausible_value(clean, tmp_path: Path, code: int) -> None:
    """Quality bad: the value is not looked at, be it plausible or wild; the mode and the window neither."""
    data = good(N).assign(quality=192, auto=True)
    data.loc[[100, 101, 320], "quality"] = code
    data.loc[101, ["pv", "auto"]] = [99.0, False]
    found = both(data, tmp_path)
    found.counted(ok=N - 3, bad_quality=3)
    alike(found, clean)


def test_uncertain_samples_are_used_and_counted(clean, tmp_path: Path) -> None:
    """A tenth of the samples uncertain: used, counted apart, the same figures to the last bit."""
    data = good(N).assign(quality=192)
    data.loc[::10, "quality"] = 80
    found = both(data, tmp_path)
    found.counted(ok=N, uncertain=N // 10)
    assert found.event == clean.event
    assert found.row == clean.row


def test_many_uncertain_samples_mark_the_index(tmp_path: Path) -> None:
    """More than a fifth of an event's samples uncertain: its figures stay, and the reason says so."""
    data = good(N).assign(quality=192)
    data.loc[300:, "quality"] = 80
    found = both(data, tmp_path)
    assert found.event.ci is not None
    assert "uncertain" in found.event.reason + found.row.reason


@pytest.mark.parametrize("given", [True, False])
def test_a_quality_that_is_not_given_counts_as_good_and_is_said(clean, tmp_path: Path, given: bool) -> None:
    """Without a column of quality all samples count as good, and the report names the file."""
    data = good(N).assign(quality=192) if given else good(N)
    found = both(data, tmp_path)
    assert found.event == clean.event
    assert found.about["quality_unknown"] == ([] if given else ["data.csv"])


def test_every_refused_sample_has_one_cause(tmp_path: Path) -> None:
    """All kinds of bad samples at once: what came in is used or has one cause, in both ways."""
    data = good(N).assign(quality=192)
    data.loc[[10, 20], "pv"] = np.nan
    data.loc[[30, 40, 50], "quality"] = 0
    data.loc[60, ["pv", "quality"]] = [np.inf, 0]
    data = pd.concat([data, data.iloc[70:75]]).sort_values("time", kind="stable", ignore_index=True)
    found = both(data, tmp_path, payloads=("frame",))
    found.counted(ok=N - 6, bad_value=2, bad_quality=4, duplicate=5)
    assert found.counts["rows"] == found.counts["ok"] + sum(found.counts.get(n, 0) for n in LOST)


def test_what_cannot_be_read_is_counted_and_the_next_is_read(tmp_path: Path) -> None:
    """Rubbish between the samples costs itself only."""
    monitor = Live(tmp_path)
    for k, single in enumerate(messages(good(N))):
        monitor.put([*single, *([("plant/LIC-101", b'{"pv": ')] if k % 100 == 0 else [])], 1.0)
    found = monitor.outcome()
    monitor.close()
    assert (found.counts["ok"], found.about["malformed"], found.row.verdict) == (N, 7, GOOD)
