"""The view's picture and its words: what is drawn is what came in, and names are data."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import psutil
import pytest

from monitor.adapters.rerun_view import picture as rerun_picture
from monitor.contract.evidence import Pane
from monitor.contract.figures import MEANINGS
from monitor.contract.records import LoopRow
from monitor.view import pages
from monitor.wire.arrow import decode_trend, decode_window
from tests.support.fake_monitor import Loop, assessment, demo_loops, row, trend_payload, window_payload
from tests.support.recordings import paths, read, texts

HOSTILE = [
    "../../etc/passwd",
    "<script>alert(1)</script>",
    "=cmd()",
    "a/*/b",
    "/abs/**",
    "\u202eLIC\u2066-1",
    "| x | **b** | [l](http://x) `c`",
    "tab\there\nline",
    "",
    "ü" * 100,
    "\ud800",
]


@pytest.fixture
def loop() -> Loop:
    return demo_loops()[0]


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


def test_layouts_cost_little(tmp_path: Path) -> None:
    """However often the layout changes: no threads are left behind, and a repetition is next to nothing."""
    file = tmp_path / "a.rrd"
    recording = rerun_picture.open_recording(None, file)
    picture = rerun_picture.Picture(recording)
    panes = [Pane(f"L{i}", 0, 10**9) for i in range(4)]
    sizes, threads = [], []
    for count in (4, 4, 3, 4):
        picture.layout(panes[:count], "L1")
        rerun_picture.flush_recording(recording)
        sizes.append(file.stat().st_size)
        threads.append(psutil.Process().num_threads())
    rerun_picture.close_recording(recording)
    first, again = sizes[0], sizes[1] - sizes[0]
    assert again < first / 10
    assert sizes[3] - sizes[1] < first
    assert threads[0] == threads[-1]


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


@pytest.mark.parametrize("name", HOSTILE)
def test_escape_shows_text_as_it_is(name: str) -> None:
    """Taking the backslashes away again gives the text; unescaped marks do not remain."""
    shown = pages.escape(name)
    plain = pages.plain(name)
    assert "".join(c for i, c in enumerate(shown) if c != "\\" or shown[i - 1 : i] == "\\") == plain
    assert "\n" not in shown
    assert len(plain) <= 200


def test_pages_of_rows_without_figures() -> None:
    """A row may have nothing but a name: every figure that is not there is a dash."""
    bare = {"loop": "X", "verdict": "retune"}
    assert "No new settings" in pages.loop_page(bare)
    assert "cannot carry a model" in pages.loop_page({**bare, "gain": None})
    assert "withheld" not in pages.loop_page({**bare, "new_kp": None})
    assert "–" in pages.overview([bare], {"retune": 1}, None, [])
    assert "No loop is flagged" in pages.overview([], {}, {"id": "m", "samples_ok": None}, [])
    assert pages.log_line({})[1] == "INFO"


def test_page_tells_old_and_new(loop: Loop) -> None:
    """Settings, indices and the model's intervals stand side by side, with units."""
    page = pages.loop_page(row(loop), assessment(loop))
    for part in (
        "| Kp \\[OP/PV\\] | 9.00 | **23.8** |",
        "GAIN = 23\\.8",
        "\\[PV/(OP s)\\]",
        "1. Kp",
        "2. Kp",
    ):
        assert part in page, page
    none = pages.loop_page({**row(loop), "ti": None, "new_ti": None})
    assert "| Ti \\[s\\] | none | **none** |" not in none  # neither had it: no line
    assert "| Ti \\[s\\] | none | **84.0** |" in pages.loop_page({**row(loop), "ti": None})


def test_page_shows_health_and_what_it_means(loop: Loop) -> None:
    """The figures that the data carry, each with unit and meaning; flags in words; nothing of what is not known."""
    sick = {**row(loop), "oscillation_period": 155.0, "stiction": None, "flags": ("oscillating", "noisy_op")}
    page = pages.loop_page(sick)
    assert "oscillating, noisy op" in page.replace("\\", "")
    assert f"| oscillation period \\[s\\] | 155 | {MEANINGS['oscillation_period'].says} |" in page
    assert MEANINGS["stiction"].says not in page
    assert "Health" not in pages.loop_page({"loop": "A", "verdict": "retune"})


def test_every_health_figure_has_a_meaning() -> None:
    """The columns from coverage to compression."""
    names = list(LoopRow.__struct_fields__)
    health = names[names.index("coverage") : names.index("compression") + 1]
    assert sorted(MEANINGS) == sorted(health)


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0.00123456, "0.00123"),
        (1234.5, "1234"),
        (0.0, "0.00"),
        (1e-9, "1.00e-09"),
        (None, "–"),
        (np.nan, "–"),
    ],
)
def test_number(value: float | None, text: str) -> None:
    assert pages.number(value) == text
