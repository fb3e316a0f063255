"""Columns as 16-bit steps: what comes out is what went in, to a step; gaps stay gaps."""

from __future__ import annotations

import base64
import json
from dataclasses import replace

import numpy as np
import pytest

from monitor.report.charts import STEPS, charts_of, pack, pack_even, pack_steps

from .tools import answers, event, window


def unpacked(column: list[object], n: int) -> np.ndarray:
    """The reading of `report.js`, in Python."""
    if len(column) < 3:
        return np.full(n, column[0] if column else np.nan)
    low, step, text = column
    codes = np.frombuffer(base64.b64decode(str(text)), dtype="<u2").astype(float)
    return np.where(codes == STEPS + 1, np.nan, float(low) + float(step) * codes)  # type: ignore[arg-type]


@pytest.mark.parametrize("scale", [1e-12, 1.0, 3e5])
def test_a_column_comes_back_to_a_step(scale: float) -> None:
    values = scale * np.random.default_rng(1).normal(50.0, 3.0, 400)
    values[[3, 77]] = np.nan
    back = unpacked(pack(values), 400)
    assert np.array_equal(np.isnan(back), np.isnan(values))
    assert np.nanmax(np.abs(back - values)) <= 2 * np.nanmax(np.abs(values)) / STEPS


@pytest.mark.parametrize("values", [[np.nan, np.nan], [1.0, 1.0], [1.0, np.nan], [np.inf, 2.0, 2.0]])
def test_columns_of_nothing_or_one_value(values: list[float]) -> None:
    back = unpacked(pack(np.array(values)), len(values))
    assert np.array_equal(back, np.where(np.isfinite(values), values, np.nan), equal_nan=True)


def test_events_come_newest_first_and_answers_with_the_set_point_first() -> None:
    charts = charts_of([event("A", 0), event("A", 1)], [window("A", 0), window("A", 1)], answers("A"))
    assert [e["title"][-8:] for e in charts["events"]] == ["01:00:00", "00:00:00"]
    assert [a["kind"] for a in charts["answers"]] == ["setpoint", "load"]
    assert charts["answers"][1]["today"] == []
    json.dumps(charts, allow_nan=False)
    newest = charts["events"][0]
    residual = unpacked(newest["pv"], 300) - unpacked(newest["model"], 300)
    assert np.abs(residual).max() == pytest.approx(0.02, rel=0.01)
    assert newest["t"] == [-60.0, 1.0, 300, 0]
    assert newest["sp"] == [[0, 50.0], [60, 55.0]]


def test_a_window_without_its_newestis_left_out() -> None:
    assert charts_of([], [window("A")], [])["events"] == []


def test_uneven_times_and_a_restless_set_point_are_packed_as_all_others() -> None:
    rng = np.random.default_rng(2)
    time, sp = np.cumsum(rng.uniform(0.5, 2.0, 90)), rng.normal(0.0, 1.0, 90)
    assert np.abs(unpacked(pack_even(time), 90) - time).max() < 1e-2
    assert np.abs(unpacked(pack_steps(sp), 90) - sp).max() < 1e-3
    assert pack_steps(np.array([1.0, np.nan])) == pack(np.array([1.0, np.nan]))


def test_a_trend_is_what_has_no_event() -> None:
    trend = replace(window("A"), id="")
    charts = charts_of([event("A")], [window("A"), trend], [])
    assert (len(charts["events"]), len(charts["trend"])) == (1, 1)
    assert charts["trend"][0]["end"] is None
    assert charts_of([], [], [])["trend"] == []
