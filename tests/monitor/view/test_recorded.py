"""An audit as a picture: what is read back from the recording is what stands in its tables."""

from __future__ import annotations

import threading
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from monitor.adapters.rerun_view import series
from monitor.contract.records import LoopRow
from monitor.view import recorded
from monitor.view.recorded import DRAWN_LOOPS, draw_audit, fleet_of, record_audit, show_drawn
from tests.monitor.report.tools import contents, event, fleet, retune, window
from tests.monitor.view.tools import Sketch
from tests.support.recordings import read as read_back
from tests.support.recordings import texts


def test_read_back_it_equals_the_tables(tmp_path: Path) -> None:
    """Each window of each loop, sample by sample, with its residual; each prediction in the size of its step."""
    audit = contents()
    record_audit(audit, tmp_path / "a.rrd")
    found = read_back(tmp_path / "a.rrd")
    for kept in audit.windows:
        columns = {
            "SP": kept.sp,
            "PV": kept.pv,
            "OP": kept.op,
            "MODEL": kept.model,
            "RESIDUAL": kept.pv - kept.model,
        }
        for name, column in columns.items():
            path = series.of_event(series.entity(kept.loop), getattr(series, name), kept.id)
            times, values = found[f"/{path}"]
            np.testing.assert_array_equal(times, kept.time)
            np.testing.assert_array_equal(values, column)
    for answers in audit.answers:
        size, level = (5.0, 50.0) if answers.kind == "setpoint" else (1.0, 0.0)  # no load has stepped
        base = f"/{series.entity(answers.loop)}/response/{answers.kind}"
        onset = window(answers.loop, 1).onset
        drawn = {"TODAY": answers.today[0], "NEW": answers.new[0], "BAND": answers.new[1:].T}
        for name, curve in drawn.items():
            times, values = found[f"{base}/{getattr(series, name)}"]
            np.testing.assert_array_equal(times, onset + np.round(answers.time * 1e9).astype(np.int64))
            np.testing.assert_array_equal(values, level + size * curve)
    (page,) = texts(tmp_path / "a.rrd", "/overview")
    places = [page.find(name) for name in ("PIC\\-7", "FIC\\-2", "TIC\\-3", "LIC\\-101")]
    assert places == sorted(places)
    assert min(places) > 0
    (page,) = texts(tmp_path / "a.rrd", f"/{series.entity('LIC-101')}/page")
    assert "| GAIN | 0.750 | **1.90** |" in page.replace("\\", "")


def test_loops_are_named_by_danger_with_their_units() -> None:
    """Tabs in the order of the rows; the event that carries the verdict in front, in words with its unit."""
    rows = [retune("PIC-7", ms=4.0, flags=("near_instability",), unit="bar", op_unit="%"), retune()]
    sketch = Sketch()
    draw_audit(contents(rows), sketch)
    ((panes, active),) = sketch.layouts
    assert active is None
    assert [pane.loop for pane in panes] == ["PIC-7", "LIC-101"]
    assert panes[0].name == "PIC-7: set-point step of 5.00 bar, 2026-03-01 01:00:00 UTC"
    assert [r.name for r in panes[0].responses] == [
        "Predicted: set-point step of 5.00 bar", "Predicted: load step of 1.00 %"
    ]  # fmt: skip
    assert sketch.scales[0].unit == "bar"
    assert "Kp [%/bar]" in sketch.pages["PIC-7"].replace("\\", "")
    assert list(sketch.fleets[0].names) == ["PIC-7", "LIC-101"]


def test_newest_samples_where_there_is_no_event() -> None:
    """And of a valve beside its events."""
    audit = contents([*fleet()[:2], retune()])
    trends = [replace(window(row.loop), id="") for row in audit.rows]
    sketch = Sketch()
    draw_audit(replace(audit, windows=[*audit.windows, *trends]), sketch)
    assert sketch.trends == ["FIC-2"]
    panes = {pane.loop: pane for pane in sketch.layouts[0][0]}
    first, last = panes["FIC-2"].recent or (0, 0)
    assert (panes["FIC-2"].start, first) == (0, int(trends[1].time[0]))
    assert last == int(trends[1].time[-1])
    assert panes["LIC-101"].recent == (0, 0)


def test_what_is_not_in_the_picture_is_said() -> None:
    """Of a large fleet the worst are drawn; who has no place among the points is counted."""
    rows = [retune(f"LIC-{k:03d}") for k in range(DRAWN_LOOPS + 3)]
    sketch = Sketch()
    draw_audit(contents([*rows, LoopRow(loop="idle")], events=1), sketch)
    assert len(sketch.layouts[0][0]) == DRAWN_LOOPS
    said = (sketch.pages[None] or "").replace("\\", "")
    assert f"The {DRAWN_LOOPS} worst of {DRAWN_LOOPS + 3} loops have charts here" in said
    assert "for want of an index or a model: 1." in said


def test_an_audit_without_evidence_is_drawn_too() -> None:
    """An older one: the fleet, the list and the log."""
    sketch = Sketch()
    draw_audit(replace(contents(), windows=[], answers=[]), sketch)
    assert sketch.layouts == [([], None)]
    assert len(sketch.lines) == len(contents().events)
    assert fleet_of([], []).ci.shape == (0,)


def test_the_newest_events_are_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(recorded, "LOGGED_EVENTS", 1)
    sketch = Sketch()
    draw_audit(contents([retune()]), sketch)
    assert len(sketch.lines) == 1
    assert event("LIC-101", 1).reason in sketch.lines[0]


def test_it_ends_by_itself_where_nobody_looks(tmp_path: Path) -> None:
    """The file is whole when it is said to be ready."""
    sizes: list[int] = []
    file = tmp_path / "a.rrd"
    show_drawn(
        lambda: lambda on: on.page("# Here"),
        file,
        None,
        threading.Event(),
        lambda: sizes.append(file.stat().st_size),
    )
    assert sizes == [file.stat().st_size]
    assert texts(file, "/overview") == ["# Here"]


def test_what_cannot_be_read_leaves_what_was_recorded_before(tmp_path: Path) -> None:
    """The file is not begun."""
    file = tmp_path / "a.rrd"
    file.write_bytes(b"before")

    def read() -> None:
        raise ValueError("no audit")

    with pytest.raises(ValueError, match="no audit"):
        show_drawn(read, file, None, threading.Event(), pytest.fail)  # type: ignore[arg-type]
    assert file.read_bytes() == b"before"
