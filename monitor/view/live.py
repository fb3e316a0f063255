"""The monitor's word, drawn as it comes: a session to hear it, a recording to draw on, and their orderly end."""

from __future__ import annotations

import contextlib
import logging
from collections.abc import Callable
from pathlib import Path
from typing import Any

from monitor.adapters import zenoh_bus
from monitor.adapters.process import Stop
from monitor.adapters.rerun_view import picture
from monitor.adapters.rerun_view.process import RerunProcess
from monitor.contract import keys

from .drawing import ViewError
from .feed import TICK_S, Feed

logger = logging.getLogger("loopsight.view")

KNOWN_WITHIN_S = 10.0
"""For the monitor to answer whether it knows an event [s]."""


def draw(
    endpoint: str,
    event: str,
    save: Path | None,
    viewer: RerunProcess | None,
    stop: Stop,
    ready: Callable[[], None],
    zenoh: str = "",
) -> None:
    """Draw what the monitor says, or one event of its history, until told to stop or the viewer has been closed.

    Parameters
    ----------
    event
        Id of the event; empty: what is said from now on.
    save
        Record into this file, too.
    viewer
        Where it is seen; ended with the drawing.
    ready
        Called once the monitor is heard.
    zenoh
        Zenoh's own configuration (.json5); empty: none.

    Raises
    ------
    ViewError
        No monitor answers at ``endpoint``, or it does not know the event.
    """
    with contextlib.ExitStack() as ending:
        if viewer is not None:
            ending.callback(viewer.stop)
        session = _session(endpoint, zenoh)
        ending.callback(session.close)  # with a callback left open the interpreter would not end
        if event and not zenoh_bus.ask(session, keys.history("**", event), KNOWN_WITHIN_S):
            raise ViewError(f"the monitor knows no event {event}")
        recording = picture.open_recording(viewer.proxy if viewer else None, save)
        try:
            _follow(Feed(session, picture.Picture(recording)), event, viewer, stop, ready)
        finally:
            stop.set()
            picture.flush_recording(recording)
            ending.close()  # the viewer first: closing waits for one that is stuck, and the file would suffer
            picture.close_recording(recording)


def _follow(
    feed: Feed, event: str, viewer: RerunProcess | None, stop: Stop, ready: Callable[[], None]
) -> None:
    try:
        if event:
            feed.pin(event)
        else:
            feed.listen()
        ready()
        while not stop.wait(TICK_S):
            feed.tick()
            if viewer is not None and not viewer.alive():
                logger.warning("the viewer has been closed")
                break
    finally:
        feed.close()
        feed.tick()  # what had come by the end belongs to the recording


def _session(endpoint: str, zenoh: str) -> Any:
    """Open a session of a client of the monitor's."""
    options = {"transport/shared_memory/enabled": False}  # a stalled view must not hold the monitor's buffers
    try:
        return zenoh_bus.open_session(mode="client", connect=[endpoint], options=options, file=zenoh)
    except zenoh_bus.BusError as error:
        raise ViewError(f"no monitor answers: {error}") from error
