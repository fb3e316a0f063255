"""The view's picture and its words: what is drawn is what came in, and names are data."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np

from monitor.adapters.rerun_view import picture as rerun_picture
from monitor.contract.evidence import Pane
from monitor.view import pages
from monitor.wire.arrow import decode_trend, decode_window
from tests.support.fake_monitor import Loop, assessment, row, trend_payload, window_payload
from tests.support.hostile import HOSTILE
from tests.support.recordings import paths, read, texts


def test_recording_holds_what_was_logged(tmp_path: Path, loop: Loop) -> None:
    """SP, PV, OP and model come back from the file as they went in; the line ends with the window."""
    loop.columns["model"][40:60] = np.nan
    window, file = decode_window(window_payload(loop)), tmp_path / "a.rrd"
    recording = rerun_picture.open_recording(None, file)
    picture = rerun_picture.Picture(recording)
    picture.window(window)
    picture.trend(decode_trend(trend_payload(loop, slice(0, 50))))
    picture.layout([Pane(loop.name, int(window.time[0]), int(window.time[-1]))])
    rerun_picture.close_recording(recording)
    series = read(file)
    base = f"/{rerun_picture.entity(loop.name)}"
    names = {
        "sp": rerun_picture.SP,
        "pv": rerun_picture.PV,
        "op": rerun_picture.OP,
        "model": rerun_picture.MODEL,
    }
    for name, path in names.items():
        times, values = series[f"{base}/event/{path}"]
        np.testing.assert_array_equal(times[:-1], loop.columns["time"])
        np.testing.assert_array_equal(values[:-1], loop.columns[name])
        assert np.isnan(values[-1])
    times, values = series[f"{base}/live/{rerun_picture.PV}"]
    np.testing.assert_array_equal(values, loop.columns["pv"][:50])
    times, values = series[f"{base}/event/{rerun_picture.ONSET}"]
    assert times[0] == loop.onset
    assert values[0] < values[1]


def test_a_hole_in_the_trend_stays_a_hole(tmp_path: Path, loop: Loop) -> None:
    """No line is drawn through missing time."""
    recording = rerun_picture.open_recording(None, tmp_path / "a.rrd")
    picture = rerun_picture.Picture(recording)
    for rows in (slice(0, 20), slice(20, 40), slice(400, 420)):
        picture.trend(decode_trend(trend_payload(loop, rows)))
    rerun_picture.close_recording(recording)
    _, values = read(tmp_path / "a.rrd")[f"/{rerun_picture.entity(loop.name)}/live/{rerun_picture.PV}"]
    np.testing.assert_array_equal(np.flatnonzero(np.isnan(values)), [40])


def test_names_are_data(tmp_path: Path, loop: Loop) -> None:
    """No name becomes a path, markdown, markup or a change of direction; no two share their entities."""
    recording = rerun_picture.open_recording(None, tmp_path / "a.rrd")
    picture = rerun_picture.Picture(recording)
    window = decode_window(window_payload(loop))
    for name in HOSTILE:
        facts = {**row(loop), "loop": name, "reason": name, "action": name}
        picture.window(replace(window, loop=name))
        picture.page(pages.loop_page(facts, {**assessment(loop), "loop": name}), name)
        picture.log(*pages.log_line({**assessment(loop), "loop": name, "reason": name}), loop.onset)
    picture.layout([Pane(name, 0, 1) for name in HOSTILE])
    picture.page(pages.overview([{**row(loop), "loop": n, "reason": n} for n in HOSTILE], {}, None, HOSTILE))
    rerun_picture.close_recording(recording)
    entities = {rerun_picture.entity(name) for name in HOSTILE}
    assert len(entities) == len(HOSTILE)
    assert all(e.startswith("loop/") and e.count("/") == 1 for e in entities)
    allowed = (*(f"/{e}/" for e in entities), "/overview", "/log", "/start", "/__properties")
    assert all(path.startswith(allowed) for path in paths(tmp_path / "a.rrd"))
    for page in texts(tmp_path / "a.rrd", "/overview") + texts(tmp_path / "a.rrd", f"/{min(entities)}/page"):
        unescaped = re.sub(r"\\.", "", page)
        assert "<" not in unescaped
        assert "](" not in unescaped
        assert "\u202e" not in page
        assert "\u2066" not in page
