"""The view's picture and its words: what is drawn is what came in, and names are data."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np

from monitor.adapters.rerun_view import picture as rerun_picture
from monitor.adapters.rerun_view import series
from monitor.contract.evidence import Answers, Fleet, Pane, Scale, Step
from monitor.view import pages
from monitor.wire.arrow import decode_trend, decode_window
from tests.support.fake_monitor import Loop, assessment, row, trend_payload, window_payload
from tests.support.hostile import HOSTILE
from tests.support.recordings import paths, read, texts


@contextmanager
def drawing(file: Path, *, live: bool = True) -> Iterator[rerun_picture.Picture]:
    """A picture that is recorded."""
    recording = rerun_picture.open_recording(None, file)
    yield rerun_picture.Picture(recording, live=live)
    rerun_picture.close_recording(recording)


def test_recording_holds_what_was_logged(tmp_path: Path, loop: Loop) -> None:
    """SP, PV, OP, model and residual come back from the file as they went in; the noise is a band about zero."""
    loop.columns["model"][40:60] = np.nan
    window, file = decode_window(window_payload(loop)), tmp_path / "a.rrd"
    with drawing(file) as picture:
        picture.window(window, Scale(noise=0.5))
        picture.trend(decode_trend(trend_payload(loop, slice(0, 50))), Scale())
        picture.layout([Pane(loop.name, int(window.time[0]), int(window.time[-1]))])
    found, base = read(file), series.entity(loop.name)
    columns = {name: loop.columns[name.lower()] for name in ("SP", "PV", "OP", "MODEL")}
    columns["RESIDUAL"] = columns["PV"] - columns["MODEL"]
    for name, column in columns.items():
        times, values = found["/" + series.of_event(base, getattr(series, name), window.id)]
        np.testing.assert_array_equal(times, loop.columns["time"])
        np.testing.assert_array_equal(values, column)
    times, values = found["/" + series.of_event(base, series.NOISE, window.id)]
    np.testing.assert_array_equal(values, [[1.0, -1.0], [1.0, -1.0]])
    times, values = found[f"/{base}/live/{series.PV}"]
    np.testing.assert_array_equal(values, loop.columns["pv"][:50])
    times, values = found["/" + series.of_event(base, series.ONSET, window.id)]
    assert times[0] == loop.onset
    assert values[0] < values[1]


def test_events_that_overlap_have_series_of_their_own(tmp_path: Path, loop: Loop) -> None:
    """Half a window later, with another model: each comes back as it went in, none as a hatch of both."""
    first = decode_window(window_payload(loop))
    later = int(first.time[len(first.time) // 2] - first.time[0])
    second = replace(first, id="second", time=first.time + later, model=first.model + 3.0)
    with drawing(tmp_path / "a.rrd") as picture:
        picture.window(first, Scale())
        picture.window(second, Scale())
    found = read(tmp_path / "a.rrd")
    for window in (first, second):
        times, values = found["/" + series.of_event(series.entity(loop.name), series.MODEL, window.id)]
        np.testing.assert_array_equal(times, window.time)
        np.testing.assert_array_equal(values, window.model)


def test_predictions_are_drawn_in_the_size_of_the_step(tmp_path: Path) -> None:
    """From where PV was; the band is that of the new settings, of today's where there are no new ones."""
    time = np.linspace(0.0, 60.0, 7)
    today, new = np.vstack([time, time - 1, time + 1]), np.vstack([time**2, time, time**3])
    unknown = np.full((3, 7), np.nan)
    with drawing(tmp_path / "a.rrd", live=False) as picture:
        picture.answers(Answers("L", "setpoint", time, today, new), Step(10**18, 2.0, 50.0))
        picture.answers(Answers("L", "load", time, today, unknown), Step(10**18, 1.0, 0.0))
    found, base = read(tmp_path / "a.rrd"), f"/{series.entity('L')}/response"
    times, values = found[f"{base}/setpoint/{series.NEW}"]
    np.testing.assert_array_equal(times, 10**18 + (time * 1e9).astype(np.int64))
    np.testing.assert_array_equal(values, 50.0 + 2.0 * new[0])
    np.testing.assert_array_equal(found[f"{base}/setpoint/{series.TODAY}"][1], 50.0 + 2.0 * today[0])
    np.testing.assert_array_equal(found[f"{base}/setpoint/{series.BAND}"][1], 50.0 + 2.0 * new[1:].T)
    np.testing.assert_array_equal(found[f"{base}/setpoint/{series.RESPONSE_SP}"][1], np.full(7, 52.0))
    np.testing.assert_array_equal(found[f"{base}/load/{series.BAND}"][1], today[1:].T)
    np.testing.assert_array_equal(found[f"{base}/load/{series.RESPONSE_SP}"][1], np.zeros(7))


def test_a_hole_in_the_trend_stays_a_hole(tmp_path: Path, loop: Loop) -> None:
    """No line is drawn through missing time."""
    with drawing(tmp_path / "a.rrd") as picture:
        for rows in (slice(0, 20), slice(20, 40), slice(400, 420)):
            picture.trend(decode_trend(trend_payload(loop, rows)), Scale())
    _, values = read(tmp_path / "a.rrd")[f"/{series.entity(loop.name)}/live/{series.PV}"]
    np.testing.assert_array_equal(np.flatnonzero(np.isnan(values)), [40])


def test_names_are_data(tmp_path: Path, loop: Loop) -> None:
    """No name, unit or id becomes a path, markdown, markup or a change of direction; no two share their entities."""
    window = decode_window(window_payload(loop))
    with drawing(tmp_path / "a.rrd") as picture:
        for name in HOSTILE:
            facts = {**row(loop), "loop": name, "reason": name, "action": name, "unit": name, "op_unit": name}
            picture.window(replace(window, loop=name, id=name), pages.scale_of(facts))
            picture.page(pages.loop_page(facts, {**assessment(loop), "loop": name}), name)
            picture.log(*pages.log_line({**assessment(loop), "loop": name, "reason": name}), loop.onset)
        picture.layout([Pane(name, 0, 1, name) for name in HOSTILE])
        picture.page(pages.overview([{**row(loop), "loop": n, "reason": n} for n in HOSTILE], {}, HOSTILE))
        ones = np.ones(len(HOSTILE))
        picture.fleet(Fleet(HOSTILE, ["retune"] * len(HOSTILE), ones, ones))
    entities = {series.entity(name) for name in HOSTILE}
    assert len(entities) == len(HOSTILE)
    assert all(e.startswith("loop/") and e.count("/") == 1 for e in entities)
    allowed = (*(f"/{e}/" for e in entities), "/overview", "/log", "/start", "/fleet/", "/__properties")
    found = paths(tmp_path / "a.rrd")
    assert all(path.startswith(allowed) for path in found)
    assert {path.count("/") for path in found if "/event/" in path} == {5}
    for page in texts(tmp_path / "a.rrd", "/overview") + texts(tmp_path / "a.rrd", f"/{min(entities)}/page"):
        unescaped = re.sub(r"\\.", "", page)
        assert "<" not in unescaped
        assert "](" not in unescaped
        assert "\u202e" not in page
        assert "\u2066" not in page
