"""One event out of a monitor's folder."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from monitor.view.stored import stored_event
from tests.monitor.view.tools import Sketch
from tests.support.fake_monitor import assessment, demo_loops, row, window_payload
from tests.support.stores import quick

GOOD = next(loop for loop in demo_loops() if loop.verdict == "good")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A store with an event of a good loop."""
    store = quick(tmp_path)
    with store.transaction():
        facts = json.dumps(assessment(GOOD)).encode()
        store.keep_assessment(GOOD.id, GOOD.key, GOOD.onset, facts, window_payload(GOOD))
    store.close()
    return tmp_path


@pytest.mark.parametrize("known", [True, False])
def test_an_event_is_drawn_whatever_the_verdict(folder: Path, known: bool) -> None:
    """With its loop's row where that is kept, and with what the event itself says where not."""
    if known:
        store = quick(folder)
        with store.transaction():
            store.keep_row(GOOD.key, json.dumps({**row(GOOD), "unit": "bar"}).encode())
        store.close()
    sketch = Sketch()
    stored_event(folder, GOOD.id)(sketch)
    assert sketch.windows == [GOOD.name]
    assert GOOD.name in (sketch.pages[GOOD.name] or "").replace("\\", "")
    ((panes, active),) = sketch.layouts
    assert active == panes[0].loop == GOOD.name
    assert panes[0].name.startswith(
        f"{GOOD.name}: set-point step of 5.00 {'bar' if known else 'PV'}, 2026-03-02"
    )


def test_what_is_not_there_is_said_in_one_line(folder: Path, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="no event 0123"):
        stored_event(folder, "0123")
    with pytest.raises(ValueError, match=r"no loopsight\.sqlite"):
        stored_event(tmp_path / "nowhere", GOOD.id)
    running = quick(folder)
    with pytest.raises(OSError, match="another monitor uses this folder"):
        stored_event(folder, GOOD.id)
    running.close()
