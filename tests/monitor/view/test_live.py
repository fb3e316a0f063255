"""The monitor's word, drawn into a recording."""

from __future__ import annotations

import threading
from pathlib import Path

import pytest

from monitor.adapters.rerun_view import series
from monitor.view.drawing import ViewError
from monitor.view.live import draw
from tests.support.fake_monitor import FakeMonitor
from tests.support.recordings import paths, texts
from tests.support.waiting import free_port, until


def test_it_says_when_the_monitor_is_heard_and_ends_in_order(tmp_path: Path, fake: FakeMonitor) -> None:
    """Told to stop at once: what had come is recorded, and the file is whole."""
    stop, file = threading.Event(), tmp_path / "a.rrd"
    draw(fake.endpoint, "", file, None, stop, stop.set)
    assert {"/start", "/overview"} & paths(file)
    assert any("Control loops" in page for page in texts(file, "/start"))


def test_one_event(tmp_path: Path, fake: FakeMonitor) -> None:
    """Its loop is drawn whatever its verdict; nothing is drawn of an event that the monitor does not know."""
    loop = next(loop for loop in fake.loops if loop.verdict == "good")
    stop, file = threading.Event(), tmp_path / "a.rrd"
    drawn = series.of_event(series.entity(loop.name), series.PV, loop.id)

    def look() -> None:
        until(lambda: drawn.encode() in file.read_bytes())
        stop.set()

    draw(fake.endpoint, loop.id, file, None, stop, threading.Thread(target=look).start)
    assert f"/{drawn}" in paths(file)
    with pytest.raises(ViewError, match="knows no event 0123"):
        draw(fake.endpoint, "0123", tmp_path / "b.rrd", None, stop, pytest.fail)
    assert not (tmp_path / "b.rrd").exists()


@pytest.mark.usefixtures("impatient")
def test_nobody_answers(tmp_path: Path) -> None:
    """One line with the endpoint."""
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    with pytest.raises(ViewError, match=f"no monitor answers: {endpoint}"):
        draw(endpoint, "", tmp_path / "a.rrd", None, threading.Event(), pytest.fail)
