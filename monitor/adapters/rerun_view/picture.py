"""The picture in Rerun: what a control engineer would draw. The only file that imports rerun.

``Picture`` takes decoded data and logs columns to a recording; where that goes (viewer, file, both) it does
not know. Paths of entities are made from the names, never the names themselves: a loop's name is data.
"""

from __future__ import annotations

import contextlib
import hashlib
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from monitor.contract.evidence import Floats, Nanos, Pane, Trend, Window
from monitor.contract.text import plain

from . import layout

TIMELINE = "time"
SP_COLOUR, PV_COLOUR, OP_COLOUR = (165, 165, 165), (70, 140, 240), (240, 150, 40)
MODEL_COLOUR, ONSET_COLOUR = (235, 60, 60), (190, 120, 255)
ONSET, SP, PV, MODEL = "1-onset", "2-sp", "3-pv", "4-model"
ONSET_OP, OP = "5-onset", "6-op"
"""Series by path: Rerun draws in the order of paths, and the thin model belongs on top of the data."""
LIVE_SPAN_S = 600.0
"""Least span of the live strip [s]: a control engineer's ten minutes."""
MARGIN_SHARE = 0.04
"""Air at both ends of an event's chart, as a share of its window."""


class Picture:
    """Draws on one recording. Every method logs at once and returns nothing."""

    def __init__(self, recording: rr.RecordingStream) -> None:
        self._recording = recording
        self._sender = layout.Sender(recording)
        self._styled: set[str] = set()
        self._last: dict[str, int] = {}
        self._legends: dict[str, rrb.Corner2D] = {}
        self.now = 0
        """Latest time drawn [ns]; pages are shown as of then, so that a recording can be scrubbed."""
        recording.log("start", _page("# Control loops\n\nWaiting for the monitor.\n"), static=True)

    def window(self, window: Window) -> None:
        """Draw an event's evidence: SP, PV and the model's PV, OP, and a mark at the onset."""
        if window.time.size == 0:
            return
        base = f"{entity(window.loop)}/event"
        self._style(base, event=True)
        values = {SP: window.sp, PV: window.pv, OP: window.op, MODEL: window.model}
        for name, column in values.items():
            self._line(f"{base}/{name}", window.time, column, broken=True)
        for name, columns in ((ONSET, (window.sp, window.pv, window.model)), (ONSET_OP, (window.op,))):
            self._mark(f"{base}/{name}", window.onset, columns)
        self._legends[window.loop] = _free_corner(window.pv)
        self._advance(int(window.time[-1]))

    def trend(self, trend: Trend) -> None:
        """Draw new samples on the live strip. A hole of more than ten usual periods stays a hole."""
        if trend.time.size == 0:
            return
        base = f"{entity(trend.loop)}/live"
        self._style(base, event=False)
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

    def log(self, text: str, level: str, time: int | None) -> None:
        """Add a line to the log of events, at ``time`` [ns] or at the latest time drawn."""
        time = self.now if time is None else time
        self._advance(time)
        self._at(time)
        self._recording.log("log", rr.TextLog(text, level=level))

    def page(self, text: str, loop: str | None = None) -> None:
        """Show markdown ``text`` as the overview, or as the page of ``loop``."""
        if not self.now and loop is None:  # no time is known that the page could be shown at
            self._recording.log("start", _page(text), static=True)
            return
        self._at(self.now)
        self._recording.log("overview" if loop is None else f"{entity(loop)}/page", _page(text))

    def layout(self, panes: Sequence[Pane], active: str | None = None) -> None:
        """Lay out anew: overview and log left, a tab for each of ``panes``, ``active`` in front."""
        self._sender.send(_blueprint(panes, self._legends, active, started=self.now > 0))

    def _style(self, base: str, *, event: bool) -> None:
        """Names, colours and widths of a loop's series, logged once. SP and OP are held between samples."""
        if base in self._styled:
            return
        self._styled.add(base)
        lines = {
            SP: ("SP [PV]", SP_COLOUR, 1.5, "StepAfter", "MinMax"),
            PV: ("PV [PV]", PV_COLOUR, 2.2, "Linear", "MinMax"),
            OP: ("OP [OP]", OP_COLOUR, 1.8, "StepAfter", "MinMax"),
        }
        if event:
            lines[MODEL] = ("model of PV [PV]", MODEL_COLOUR, 1.3, "Linear", "Average")
            lines[ONSET] = lines[ONSET_OP] = ("onset", ONSET_COLOUR, 1.5, "Linear", "Off")
        for name, (words, colour, width, mode, policy) in lines.items():
            style = rr.SeriesLines(
                names=words,
                colors=[colour],
                widths=[width],
                interpolation_mode=mode,
                aggregation_policy=policy,
            )
            self._recording.log(f"{base}/{name}", style, static=True)

    def _line(self, path: str, time: Nanos, values: Floats, *, broken: bool = False) -> None:
        """Log one column; ``broken`` ends it, so that no line leads on to the next event."""
        if broken:
            time, values = np.append(time, time[-1] + 1), np.append(values, np.nan)
        index = rr.TimeColumn(TIMELINE, timestamp=time.astype("datetime64[ns]"))
        self._recording.send_columns(path, indexes=[index], columns=rr.Scalars.columns(scalars=values))

    def _mark(self, path: str, onset: int, columns: Sequence[Floats]) -> None:
        """Vertical line at the onset, as high as what the chart holds: two points a nanosecond apart."""
        values = np.concatenate(columns)
        values = values[np.isfinite(values)]
        if values.size == 0:
            return
        ends = np.array([values.min(), values.max(), np.nan])
        self._line(path, np.array([onset, onset + 1, onset + 2], np.int64), ends)

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


def entity(loop: str) -> str:
    """Path of a loop's entities: readable where the name is plain, always unique, never a path of its own."""
    readable = re.sub(r"[^A-Za-z0-9_-]", "_", loop)[:40]
    digest = hashlib.blake2b(loop.encode("utf-8", "surrogatepass"), digest_size=4).hexdigest()
    return f"loop/{readable}-{digest}"


def _page(text: str) -> rr.TextDocument:
    return rr.TextDocument(text, media_type="text/markdown")


def _free_corner(pv: Floats) -> rrb.Corner2D:
    """Corner that the last half of PV leaves free for the legend."""
    known, late = pv[np.isfinite(pv)], pv[pv.size // 2 :]
    late = late[np.isfinite(late)]
    high = late.size > 0 and float(np.median(late)) > (float(known.min()) + float(known.max())) / 2
    return rrb.Corner2D.RightBottom if high else rrb.Corner2D.RightTop


def _blueprint(
    panes: Sequence[Pane], legends: Mapping[str, rrb.Corner2D], active: str | None, *, started: bool
) -> rrb.Blueprint:
    overview = rrb.TextDocumentView(origin="/overview" if started else "/start", name="Overview")
    hidden = rrb.encodings.TimelineColumn(TIMELINE, visible=False)  # too narrow to read; the lines tell it
    log = rrb.TextLogView(
        origin="/log",
        name="Events",
        columns=rrb.TextLogColumns(timeline_columns=[hidden], text_log_columns=["loglevel", "body"]),
        format_options=rrb.TextLogFormat(monospace_body=False),
    )
    root: rrb.Horizontal | rrb.Vertical = rrb.Vertical(overview, log, row_shares=[3, 2])
    if panes:
        names = [pane.loop for pane in panes]
        front = names.index(active) if active in names else 0
        tabs: list[rrb.Container] = [_tab(pane, legends) for pane in panes]
        if len(panes) > 1:
            tabs.append(_small_multiples(panes))
        root = rrb.Horizontal(root, rrb.Tabs(*tabs, active_tab=front), column_shares=[1.1, 3])
    return rrb.Blueprint(
        root,
        rrb.TimePanel(state="collapsed", timeline=TIMELINE, play_state="following"),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        auto_layout=False,
        auto_views=False,
    )


def _tab(pane: Pane, legends: Mapping[str, rrb.Corner2D]) -> rrb.Horizontal:
    """One loop: its event above, PV and OP on one time axis; what it does now below; the advice beside."""
    name, corner = plain(pane.loop, 60), legends.get(pane.loop, rrb.Corner2D.RightTop)
    other = rrb.Corner2D.RightTop if corner == rrb.Corner2D.RightBottom else rrb.Corner2D.RightBottom
    charts = rrb.Vertical(
        _chart(pane, (ONSET, SP, PV, MODEL), f"{name}: SP, PV and model", corner),
        _chart(pane, (ONSET_OP, OP), f"{name}: OP", other),
        _chart(pane, (SP, PV), f"{name}: now", rrb.Corner2D.LeftTop, live=True),
        row_shares=[5, 3, 2.5],
    )
    page = rrb.TextDocumentView(origin=f"/{entity(pane.loop)}/page", name="Advice")
    return rrb.Horizontal(charts, page, column_shares=[2, 1], name=name)


def _small_multiples(panes: Sequence[Pane]) -> rrb.Grid:
    """All flagged loops' events side by side."""
    charts = [_chart(pane, (ONSET, SP, PV, MODEL), plain(pane.loop, 60), None) for pane in panes]
    return rrb.Grid(*charts, name="All flagged")


def _chart(
    pane: Pane, series: Sequence[str], name: str, legend: rrb.Corner2D | None, *, live: bool = False
) -> rrb.TimeSeriesView:
    origin = f"/{entity(pane.loop)}/{'live' if live else 'event'}"
    return rrb.TimeSeriesView(
        origin=origin,
        contents=[f"{origin}/{one}" for one in series],
        name=name,
        plot_legend=rrb.PlotLegend(legend, visible=legend is not None),
        interaction=rrb.PlotInteraction(tooltip_mode="All"),
        **(_recent(pane) if live else _event(pane)),
    )


def _event(pane: Pane) -> dict[str, Any]:
    """Both axes' data: the event's window with some air. Without a window: all there is."""
    if pane.end <= pane.start:
        return {}
    air = int(MARGIN_SHARE * (pane.end - pane.start))
    absolute = rrb.TimeRangeBoundary.absolute
    start, end = absolute(nanos=pane.start - air), absolute(nanos=pane.end + air)
    return {
        "axis_x": rrb.TimeAxis(view_range=rr.TimeRange(start=start, end=end)),
        "time_ranges": rrb.VisibleTimeRange(TIMELINE, start=start, end=end),
    }


def _recent(pane: Pane) -> dict[str, Any]:
    """Axis and data: the last window's length before the cursor, at least ``LIVE_SPAN_S``."""
    seconds = max(LIVE_SPAN_S, (pane.end - pane.start) / 1e9)
    relative = rrb.TimeRangeBoundary.cursor_relative
    start, end = relative(seconds=-seconds), relative()
    return {
        "axis_x": rrb.TimeAxis(view_range=rr.TimeRange(start=start, end=end)),
        "time_ranges": rrb.VisibleTimeRange(TIMELINE, start=start, end=end),
    }
