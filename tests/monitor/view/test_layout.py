"""When the view lays out anew: rarely."""

from __future__ import annotations

from dataclasses import replace

import pytest

from monitor.contract.evidence import Pane, Window
from monitor.view.layout import QUIET_TICKS, Layout
from monitor.wire.arrow import decode_window
from tests.monitor.view.tools import Sketch
from tests.support.fake_monitor import demo_loops, window_payload


@pytest.fixture
def window() -> Window:
    return replace(decode_window(window_payload(demo_loops()[0])), id="a", loop="L")


def test_other_loops_at_once(window: Window) -> None:
    """The one that is new in front; where there is no window yet there is no span."""
    sketch = Sketch()
    layout = Layout(sketch)
    layout.update(["L"], {"L": window}, {})
    panes, active = sketch.layouts[-1]
    assert panes == [Pane("L", int(window.time[0]), int(window.time[-1]))]
    assert active == "L"
    assert layout.fitted("L") == "a"
    for _ in range(2):
        layout.update(["M", "L"], {"L": window}, {})
    assert [[pane.loop for pane in panes] for panes, _ in sketch.layouts] == [["L"], ["M", "L"]]
    assert sketch.layouts[-1][1] == "M"
    assert sketch.layouts[-1][0][0] == Pane("M", 0, 0)
    assert layout.fitted("M") == ""


def test_other_evidence_in_quiet_times(window: Window) -> None:
    """A newer event that does not stand for the loop changes nothing; one that does waits for five minutes."""
    sketch = Sketch()
    layout = Layout(sketch)
    layout.update(["L"], {"L": window}, {"L": "a"})
    newer = replace(window, id="b")
    for _ in range(QUIET_TICKS):
        layout.update(["L"], {"L": newer}, {"L": "a"})
    assert len(sketch.layouts) == 1
    layout.update(["L"], {"L": newer}, {"L": "b"})
    assert len(sketch.layouts) == 2
    layout.update(["L"], {"L": window}, {"L": "a"})
    assert len(sketch.layouts) == 2
    assert layout.fitted("L") == "b"


def test_many_changes_become_slower() -> None:
    """Loops that come and go: each layout is sent later than the last one."""
    sketch = Sketch()
    layout = Layout(sketch)
    for tick in range(200):
        layout.update(["L", "M"] if tick % 2 else ["L"], {}, {})
    assert 2 <= len(sketch.layouts) <= 15
