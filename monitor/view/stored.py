"""One event out of the state folder of a monitor that does not run."""

from __future__ import annotations

from functools import partial
from pathlib import Path

from monitor.adapters.store import Store
from monitor.contract.evidence import Pane, Window
from monitor.wire.arrow import decode_window
from monitor.wire.encode import decode_record

from . import pages
from .drawing import Draw, Drawing
from .pages import Row
from .selection import as_row


def stored_event(folder: Path, event: str) -> Draw:
    """Read an event, whatever its loop's verdict; return what draws it.

    Parameters
    ----------
    folder
        A monitor's ``--state``.
    event
        Id of the event.

    Raises
    ------
    ValueError
        The folder holds no monitor's state, or no such event.
    OSError
        It cannot be read, or a monitor uses it.
    """
    if not (folder / "loopsight.sqlite").is_file():
        raise ValueError(f"{folder}: no loopsight.sqlite, expected the state folder of a monitor (--state)")
    store = Store(folder)
    try:
        found, evidence = store.assessment(event), store.window(event)
        row = store.rows().get("" if found is None else found[0])
    finally:
        store.close()
    if found is None or evidence is None:
        raise ValueError(f"{folder}: no event {event}, or it is no longer kept")
    assessment, window = decode_record(found[1]), decode_window(evidence[1])
    facts = as_row(assessment) if row is None else decode_record(row)
    return partial(_draw, assessment, window, facts)


def _draw(assessment: Row, window: Window, facts: Row, on: Drawing) -> None:
    scale = pages.scale_of(facts)
    on.window(window, scale)
    on.log(*pages.log_line(assessment), int(window.time[-1]))
    on.page(pages.loop_page(facts, assessment), window.loop)
    on.page(pages.overview([facts], {}, [f"One event of {window.loop}, as it is kept."]))
    title = f"{window.loop}: {pages.event_title(assessment, scale)}"
    on.layout(
        [Pane(window.loop, int(window.time[0]), int(window.time[-1]), title, recent=(0, 0))], window.loop
    )
