"""An audit as a picture: the fleet, the loops by danger, and of each its events, its prediction and its page."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

import numpy as np

from monitor.adapters.process import Stop
from monitor.adapters.rerun_view import picture
from monitor.adapters.rerun_view.process import RerunProcess
from monitor.contract.danger import TO_RETUNE, danger
from monitor.contract.evidence import Answers, Fleet, Pane, Response, Scale, Step, Trend, Window
from monitor.contract.fleet import ci_and_ms
from monitor.contract.records import RETUNE, Assessment, LoopRow, by_loop
from monitor.contract.summary import WITH_TREND, Contents
from monitor.wire.encode import decode_record, encode_record

from . import pages
from .drawing import Draw, Drawing

DRAWN_LOOPS = 60
"""The worst, with charts of their own: five dozens of tabs. The report has hundreds, and the tables all."""
LOGGED_EVENTS = 2000
"""The newest."""
LOOK_EVERY_S = 0.25
"""Between two looks at the viewer [s]."""


def show_drawn(
    read: Callable[[], Draw],
    save: Path | None,
    viewer: RerunProcess | None,
    stop: Stop,
    ready: Callable[[], None],
) -> None:
    """Draw once, and keep it seen until told to stop or the viewer has been closed; without a viewer end at once.

    Parameters
    ----------
    read
        Returns what draws; called before there is a recording, which it may refuse.
    save
        Record into this file, too.
    viewer
        Where it is seen; ended at the end.
    ready
        Called once all is drawn.
    """
    try:
        _record(read(), viewer.proxy if viewer else None, save)
        ready()
        while viewer is not None and viewer.alive() and not stop.wait(LOOK_EVERY_S):
            pass
    finally:
        if viewer is not None:
            viewer.stop()


def record_audit(contents: Contents, file: Path) -> None:
    """Write a recording of an audit."""
    _record(partial(draw_audit, contents), None, file)


def _record(draw: Draw, proxy: str | None, save: Path | None) -> None:
    """Draw once, into a viewer, a file, or both."""
    recording = picture.open_recording(proxy, save)
    try:
        draw(picture.Picture(recording, live=False))
    finally:
        picture.close_recording(recording)


def draw_audit(contents: Contents, on: Drawing) -> None:
    """Draw an audit: its worst loops with charts, all loops in the picture of the fleet, the newest events as lines."""
    kinds = contents.summary.kinds
    windows, answers, events = by_loop(contents.windows), by_loop(contents.answers), by_loop(contents.events)
    seen = [row for row in contents.rows if row.loop in windows and kinds[row.loop] != "good"]
    panes = []
    for row in seen[:DRAWN_LOOPS]:
        own = windows[row.loop], answers.get(row.loop, ()), events.get(row.loop, ())
        panes.append(_loop(on, row, *own, strip=kinds[row.loop] in WITH_TREND))
    for event in sorted(contents.events, key=lambda e: e.start)[-LOGGED_EVENTS:]:
        on.log(*pages.log_line(decode_record(encode_record(event))), event.end)
    on.fleet(fleet_of(contents.rows, [kinds[row.loop] for row in contents.rows]))
    flagged = [decode_record(encode_record(row)) for row in contents.rows if danger(row) <= TO_RETUNE]
    on.page(pages.overview(flagged, contents.summary.counts, _closing(contents, len(seen))))
    on.layout(panes)


def fleet_of(rows: Sequence[LoopRow], kinds: Sequence[str]) -> Fleet:
    """Return the rows that have a place in the picture of the fleet, in their order."""
    found = [
        (row.loop, kind, *place) for row, kind in zip(rows, kinds, strict=True) if (place := ci_and_ms(row))
    ]
    names, whats, ci, ms = zip(*found, strict=True) if found else ((), (), (), ())
    return Fleet(names, whats, np.array(ci, dtype=np.float64), np.array(ms, dtype=np.float64))


def _loop(
    on: Drawing,
    row: LoopRow,
    windows: Sequence[Window],
    answers: Sequence[Answers],
    events: Sequence[Assessment],
    *,
    strip: bool,
) -> Pane:
    """Draw a loop; return where its charts look."""
    facts = decode_record(encode_record(row))
    scale = pages.scale_of(facts)
    by_id = {event.id: event for event in events}
    judged = [(by_id[w.id], w) for w in windows if w.id in by_id]
    for _, window in judged:
        on.window(window, scale)
    span, name, event = (0, 0), "", None
    if judged:
        best, window = max(judged, key=_worth)
        event = decode_record(encode_record(best))
        span = int(window.time[0]), int(window.time[-1])
        name = f"{row.loop}: {pages.event_title(event, scale)}"
    responses = tuple(
        _response(on, one, judged, scale) for one in sorted(answers, key=lambda a: a.kind, reverse=True)
    )
    newest = next((w for w in windows if not w.id), None)
    recent = (0, 0)
    if newest is not None and (strip or not judged):
        on.trend(Trend(row.loop, newest.time, newest.sp, newest.pv, newest.op), scale)
        recent = int(newest.time[0]), int(newest.time[-1])
    on.page(pages.loop_page(facts, event), row.loop)
    return Pane(row.loop, *span, name, responses, recent)


def _worth(one: tuple[Assessment, Window]) -> tuple[bool, bool, int]:
    """Sort key of events with their windows: what carries a verdict, what has a model, the newest."""
    event, window = one
    return event.verdict == RETUNE, bool(np.isfinite(window.model).any()), window.onset


def _response(
    on: Drawing, answers: Answers, judged: Sequence[tuple[Assessment, Window]], scale: Scale
) -> Response:
    """Draw predicted responses to the loop's newest step of that kind, or to a unit step where there was none."""
    own = [one for one in judged if one[0].kind == answers.kind]
    if own:
        event, window = own[-1]
        before = window.sp[: max(int(np.searchsorted(window.time, window.onset)), 1)]
        step = Step(window.onset, event.amplitude, float(before[-1]))
    else:
        step = Step(judged[-1][1].onset if judged else 0, 1.0, 0.0)
    on.answers(answers, step)
    end = step.at + int(answers.time[-1] * 1e9)
    return Response(
        answers.kind, step.at, end, f"Predicted: {pages.step_words(answers.kind, step.size, scale)}"
    )


def _closing(contents: Contents, seen: int) -> list[str]:
    """Say what is not in the picture."""
    placed = sum(ci_and_ms(row) is not None for row in contents.rows)
    said = []
    if placed < len(contents.rows):
        missing = len(contents.rows) - placed
        said.append(f"Not in the picture of the fleet, for want of an index or a model: {missing}.")
    if seen > DRAWN_LOOPS:
        said.append(f"The {DRAWN_LOOPS} worst of {seen} loops have charts here; report.html has more.")
    return said
