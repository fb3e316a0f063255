"""Layouts cost little."""

from __future__ import annotations

from pathlib import Path

import psutil

from monitor.adapters.rerun_view import picture as rerun_picture
from monitor.contract.evidence import Pane


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
