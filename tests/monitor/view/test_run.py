"""What the view's process does first: a viewer, or none, or another one, and what it says."""

from __future__ import annotations

import threading
from pathlib import Path
from typing import Any

import pytest

from monitor.adapters.rerun_view.process import RerunError
from monitor.view import run
from monitor.view.drawing import ViewError
from monitor.view.run import Wanted, look_back, show, watch


class Viewer:
    """Stands for a program of Rerun's."""

    url = "http://127.0.0.1:1/"
    proxy = ""

    def __init__(self) -> None:
        self.lives = True

    def alive(self) -> bool:
        """Until stopped."""
        return self.lives

    def stop(self) -> None:
        """Die."""
        self.lives = False


@pytest.fixture
def viewer(monkeypatch: pytest.MonkeyPatch) -> Viewer:
    """The one that the web page starts; there is no window here."""
    made = Viewer()

    def broken(_: Any) -> None:
        raise RerunError("no graphics")

    monkeypatch.setattr(run.process, "serve_web", lambda _: made)
    monkeypatch.setattr(run.process, "open_native", broken)
    monkeypatch.setattr(run.process, "has_display", lambda: True)
    return made


def test_a_recording_is_shown_until_told(
    viewer: Viewer, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The line that the parent reads; the browser is opened where that is wanted; the viewer is ended."""
    opened: list[str] = []
    monkeypatch.setattr(run.webbrowser, "open", opened.append)
    stop = threading.Event()
    stop.set()
    show(Path("a.rrd"), Wanted(browser=True), stop)
    assert capsys.readouterr().out == f"view {viewer.url}\n"
    assert opened == [viewer.url]
    assert not viewer.lives


def test_a_viewer_that_has_been_closed_ends_it(viewer: Viewer) -> None:
    """And what hangs then is ended by force."""
    viewer.lives = False
    stop = threading.Event()
    show(Path("a.rrd"), Wanted(), stop)
    assert stop.is_set()


@pytest.mark.parametrize("display", [True, False])
def test_a_window_that_cannot_be_opened_is_a_page(
    viewer: Viewer, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture, display: bool
) -> None:
    """It says so, and why."""
    monkeypatch.setattr(run.process, "has_display", lambda: display)
    viewer.lives = False
    show(Path("a.rrd"), Wanted("native"), threading.Event())
    assert caplog.messages == [
        "no window (no graphics): showing the web page instead"
        if display
        else "no display here: showing the web page instead of a window"
    ]


def test_a_viewer_that_is_missing_is_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    """Even where nothing is to be shown: what records needs it, too."""

    def missing() -> None:
        raise RerunError("the Rerun viewer is not installed")

    monkeypatch.setattr(run.process, "program", missing)
    with pytest.raises(ViewError, match="not installed"):
        watch("tcp/127.0.0.1:1", Wanted("none", Path("a.rrd")), threading.Event())


def test_what_is_over_is_drawn_and_ends_by_itself(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Where it is only recorded."""
    drawn: list[Any] = []
    look_back(lambda: drawn.append, Wanted("none", tmp_path / "a.rrd"), threading.Event())
    assert len(drawn) == 1
    assert capsys.readouterr().out == "view none\n"
    assert (tmp_path / "a.rrd").stat().st_size > 0
