"""The picture in Rerun: what a control engineer would draw.

``Picture`` takes decoded data and logs columns to a recording; where that goes (viewer, file, both) it does
not know.
"""

from __future__ import annotations

import contextlib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from monitor.contract.evidence import Answers, Fleet, Floats, Nanos, Pane, Scale, Step, Trend, Window
from monitor.contract.records import SETPOINT

from . import fleet, layout, panes, series
from .series import (
    BAND,
    MODEL,
    NEW,
    NOISE,
    ONSET,
    ONSET_OP,
    OP,
    PV,
    RESIDUAL,
    RESPONSE_SP,
    SP,
    TIMELINE,
    TODAY,
)


class Picture:
    """Draws on one recording. Every method logs at once and returns nothing.

    Parameters
    ----------
    live
        Whether it grows: pages are shown as of the latest time drawn, so that a recording can be scrubbed.
        Otherwise they are always there.
    """

    def __init__(self, recording: rr.RecordingStream, *, live: bool = True) -> None:
        self._recording = recording
        self._live = live
        self._sender = layout.Sender(recording)
        self._styled: set[str] = set()
        self._last: dict[str, int] = {}
        self._legends: dict[str, rrb.Corner2D] = {}
        self._modelled: set[str] = set()
        self.now = 0
        """Latest time drawn [ns]."""
        for name, drawn in fleet.frame().items():
            recording.log(f"fleet/{name}", drawn, static=True)
        if live:
            recording.log("start", _page("# Control loops\n\nWaiting for the monitor.\n"), static=True)

    def window(self, window: Window, scale: Scale) -> None:
        """Draw an event's evidence: SP, PV, the model's PV and what it leaves, OP, and a mark at the onset.

        Each event has series of its own, so that those that overlap stay apart.
        """
        if window.time.size == 0:
            return
        base = series.entity(window.loop)
        residual = window.pv - window.model
        values = {SP: window.sp, PV: window.pv, OP: window.op, MODEL: window.model, RESIDUAL: residual}
        paths = {name: series.of_event(base, name, window.id) for name in series.event_looks(scale)}
        self._at(int(window.time[0]))
        for name, look in series.event_looks(scale).items():
            # not static: what is static stays in the viewer's memory for ever
            self._recording.log(paths[name], look)
        for name, column in values.items():
            self._line(paths[name], window.time, column)
        for name, columns in ((ONSET, (window.sp, window.pv, window.model)), (ONSET_OP, (window.op,))):
            self._mark(paths[name], window.onset, columns)
        if np.isfinite(residual).any():
            self._modelled.add(window.loop)
        if scale.noise is not None and window.loop in self._modelled:
            ends = series.NOISE_SD * scale.noise * np.array([[1.0, -1.0], [1.0, -1.0]])
            self._line(paths[NOISE], window.time[[0, -1]], ends)
        self._legends[window.loop] = _free_corner(window.pv)
        self._advance(int(window.time[-1]))

    def answers(self, answers: Answers, step: Step) -> None:
        """Draw predicted responses to a step: by today's settings, by the new ones, and their band.

        The band is that of the new settings; of today's where there are no new ones.
        """
        base = f"{series.entity(answers.loop)}/response/{answers.kind}"
        for name, look in series.response_looks().items():
            self._recording.log(f"{base}/{name}", look, static=True)
        time = step.at + np.round(answers.time * 1e9).astype(np.int64)
        today, new = (step.level + step.size * curves for curves in (answers.today, answers.new))
        banded = new if np.isfinite(new).any() else today
        moved = step.size if answers.kind == SETPOINT else 0.0
        setpoint = np.full(len(time), step.level + moved)
        for name, values in ((RESPONSE_SP, setpoint), (TODAY, today[0]), (NEW, new[0]), (BAND, banded[1:].T)):
            self._line(f"{base}/{name}", time, values)
        self._advance(int(time[-1]))

    def trend(self, trend: Trend, scale: Scale) -> None:
        """Draw new samples on the live strip. A hole of more than ten usual periods stays a hole."""
        if trend.time.size == 0:
            return
        base = f"{series.entity(trend.loop)}/live"
        if base not in self._styled:
            self._styled.add(base)
            for name, look in series.live_looks(scale).items():
                self._recording.log(f"{base}/{name}", look, static=True)
        last = self._last.get(base)
        period = float(np.median(np.diff(trend.time))) if trend.time.size > 1 else 0.0
        hole = last is not None and period > 0 and trend.time[0] - last > 10 * period
        for name, column in ((SP, trend.sp), (PV, trend.pv), (OP, trend.op)):
            path = f"{base}/{name}"
            if hole and last is not None:
                self._line(path, np.array([last + 1], np.int64), np.array([np.nan]))
            self._line(path, trend.time, column)
        self._last[base] = int(trend.time[-1])
        self._advance(int(trend.time[-1]))

    def fleet(self, loops: Fleet) -> None:
        """Draw all loops as of now: CI against Ms."""
        self._at(self.now)
        for name, drawn in fleet.points(loops).items():
            self._recording.log(f"fleet/{name}", drawn, static=not self._live)

    def log(self, text: str, level: str, time: int | None) -> None:
        """Add a line to the log of events, at ``time`` [ns] or at the latest time drawn."""
        time = self.now if time is None else time
        self._advance(time)
        self._at(time)
        self._recording.log("log", rr.TextLog(text, level=level))

    def page(self, text: str, loop: str | None = None) -> None:
        """Show markdown ``text`` as the overview, or as the page of ``loop``."""
        if self._live and not self.now and loop is None:  # no time is known that the page could be shown at
            self._recording.log("start", _page(text), static=True)
            return
        self._at(self.now)
        path = "overview" if loop is None else f"{series.entity(loop)}/page"
        self._recording.log(path, _page(text), static=not self._live)

    def layout(self, shown: Sequence[Pane], active: str | None = None) -> None:
        """Lay out anew: overview and log left, the fleet and a tab for each of ``shown``, ``active`` in front."""
        started = self.now > 0 or not self._live
        self._sender.send(panes.blueprint(shown, self._legends, self._modelled, active, started=started))

    def _line(self, path: str, time: Nanos, values: Floats) -> None:
        """Log columns ``(n,)`` or ``(n, m)``."""
        index = rr.TimeColumn(TIMELINE, timestamp=time.astype("datetime64[ns]"))
        self._recording.send_columns(path, indexes=[index], columns=rr.Scalars.columns(scalars=values))

    def _mark(self, path: str, onset: int, columns: Sequence[Floats]) -> None:
        """Vertical line at the onset, as high as what the chart holds: two points a nanosecond apart."""
        values = np.concatenate(columns)
        values = values[np.isfinite(values)]
        if values.size:
            self._line(path, np.array([onset, onset + 1], np.int64), np.array([values.min(), values.max()]))

    def _advance(self, time: int) -> None:
        self.now = max(self.now, time)

    def _at(self, time: int) -> None:
        self._recording.set_time(TIMELINE, timestamp=np.datetime64(time, "ns"))


def open_recording(proxy: str | None, save: Path | None) -> rr.RecordingStream:
    """Open a recording that goes to a viewer's ``proxy`` address, to the file ``save``, or to both."""
    recording = rr.RecordingStream("loopsight")
    sinks: list[Any] = [rr.GrpcSink(proxy)] if proxy else []
    if save is not None:
        sinks.append(rr.FileSink(str(save)))
    recording.set_sinks(*sinks)
    return recording


def flush_recording(recording: rr.RecordingStream, patience: float = 2.0) -> None:
    """Hand over what is left; what a viewer does not take within ``patience`` [s] is lost to it."""
    with contextlib.suppress(RuntimeError, ValueError):  # the viewer is gone, or stuck
        recording.flush(timeout_sec=patience)


def close_recording(recording: rr.RecordingStream) -> None:
    """Hand over what is left and close. Waits for a viewer that is stuck: end that first."""
    flush_recording(recording)
    recording.disconnect()


def _page(text: str) -> rr.TextDocument:
    return rr.TextDocument(text, media_type="text/markdown")


def _free_corner(pv: Floats) -> rrb.Corner2D:
    """Corner that the last half of PV leaves free for the legend."""
    known, late = pv[np.isfinite(pv)], pv[pv.size // 2 :]
    late = late[np.isfinite(late)]
    high = late.size > 0 and float(np.median(late)) > (float(known.min()) + float(known.max())) / 2
    return rrb.Corner2D.RightBottom if high else rrb.Corner2D.RightTop
