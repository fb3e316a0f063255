"""What runs inside the view's process: a viewer is started, then the monitor is heard, until told to stop."""

from __future__ import annotations

import logging
import os
import sys
import webbrowser
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from monitor.adapters.process import Stop
from monitor.adapters.rerun_view import process
from monitor.adapters.rerun_view.process import RerunError, RerunProcess

from .drawing import Draw, ViewError

logger = logging.getLogger("loopsight.view")

LOOK_EVERY_S = 0.25
"""Between two looks at a viewer that shows a recording [s]."""


@dataclass(frozen=True, slots=True)
class Wanted:
    """What is to be seen, and where."""

    how: str = "web"
    """``web`` (a local page), ``native`` (a window) or ``none``."""
    save: Path | None = None
    """Record into this file."""
    event: str = ""
    """Show this event of the monitor's history alone."""
    browser: bool = False
    """Open the page in the default browser."""
    zenoh: str = ""
    """Zenoh's own configuration (.json5); empty: none."""


def show(file: Path, wanted: Wanted, stop: Stop) -> None:
    """Show a recording until told to stop, or until the viewer has been closed.

    Raises
    ------
    ViewError
        The viewer is missing or does not start.
    """
    viewer = _viewer(wanted.how, file)
    try:
        _announce(viewer, wanted.browser)
        while viewer is not None and viewer.alive() and not stop.wait(LOOK_EVERY_S):
            pass
    finally:
        stop.set()
        if viewer is not None:
            viewer.stop()


def watch(endpoint: str, wanted: Wanted, stop: Stop) -> None:
    """Show the monitor at ``endpoint`` until told to stop, or until the viewer has been closed.

    Raises
    ------
    ViewError
        The viewer is missing or does not start, no monitor answers, or it does not know the event.
    """
    os.environ.setdefault("RUST_LOG", "off")  # a viewer that has gone is told in our words, once
    viewer = _viewer(wanted.how)
    from . import live  # noqa: PLC0415 (what it imports starts threads, and the viewer is forked)

    try:
        ready = partial(_announce, viewer, wanted.browser)
        live.draw(endpoint, wanted.event, wanted.save, viewer, stop, ready, wanted.zenoh)
    finally:
        stop.set()


def look_back(read: Callable[[], Draw], wanted: Wanted, stop: Stop) -> None:
    """Show what is over, until told to stop or the viewer has been closed.

    Parameters
    ----------
    read
        Returns what draws it; called when the viewer has been started.

    Raises
    ------
    ViewError
        The viewer is missing or does not start.
    """
    viewer = _viewer(wanted.how)
    from . import recorded  # noqa: PLC0415 (what it imports starts threads, and the viewer is forked)

    recorded.show_drawn(read, wanted.save, viewer, stop, lambda: _announce(viewer, wanted.browser))


def _viewer(how: str, file: Path | None = None) -> RerunProcess | None:
    """Start what shows the picture; None where it is to be seen nowhere. Before all else, since it is forked."""
    try:
        if how == "none":
            process.program()
            return None
        if how == "native":
            if process.has_display():
                try:
                    return process.open_native(file)
                except RerunError as error:
                    logger.warning("no window (%s): showing the web page instead", error)
            else:
                logger.warning("no display here: showing the web page instead of a window")
        return process.serve_web(file)
    except RerunError as error:
        raise ViewError(str(error)) from error


def _announce(viewer: RerunProcess | None, browser: bool) -> None:
    """Say where it can be seen, in the line that `ViewProcess` reads."""
    sys.stdout.write(f"view {viewer.url}\n" if viewer else "view none\n")
    sys.stdout.flush()
    if browser and viewer and viewer.url.startswith("http:"):
        webbrowser.open(viewer.url)
