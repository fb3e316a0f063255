"""How the picture is laid out: the fleet and a tab for each loop, its charts on the time that matters."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import Any

import rerun as rr
import rerun.blueprint as rrb

from monitor.contract.evidence import Pane, Response
from monitor.contract.fleet import HEIGHT, WIDTH
from monitor.contract.text import plain

from .fleet import ROW, STRETCH
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
    entity,
)

LIVE_SPAN_S = 600.0
"""Least span of the live strip [s]: a control engineer's ten minutes."""
MARGIN_SHARE = 0.04
"""Air at both ends of a chart, as a share of what it shows."""
GROUP_TABS = 12
"""Loops that lie side by side: of more, each dozen is a tab of its own."""
EVENT_ROWS, RESIDUAL_ROWS, OUTPUT_ROWS, RESPONSE_ROWS, STRIP_ROWS = 5.0, 1.8, 2.6, 3.0, 2.3
"""Heights of a loop's charts, as shares."""


def blueprint(
    panes: Sequence[Pane],
    legends: Mapping[str, rrb.Corner2D],
    modelled: Collection[str],
    active: str | None = None,
    *,
    started: bool,
) -> rrb.Blueprint:
    """Return the layout: overview and log left; the fleet and a tab for each of ``panes``.

    Parameters
    ----------
    legends
        Where the charts of each loop leave room for the legend.
    modelled
        Loops with a model.
    active
        Loop that lies in front; None: the fleet.
    started
        Whether there is anything beside the first page.
    """
    overview = rrb.TextDocumentView(origin="/overview" if started else "/start", name="Overview")
    hidden = rrb.encodings.TimelineColumn(TIMELINE, visible=False)  # too narrow to read; the lines tell it
    log = rrb.TextLogView(
        origin="/log",
        name="Events",
        columns=rrb.TextLogColumns(timeline_columns=[hidden], text_log_columns=["loglevel", "body"]),
        format_options=rrb.TextLogFormat(monospace_body=False),
    )
    left = rrb.Vertical(overview, log, row_shares=[3, 2])
    names = [pane.loop for pane in panes]
    front = names.index(active) if active in names else None
    groups = _groups([_tab(pane, legends, pane.loop in modelled) for pane in panes], front)
    in_front = 0 if front is None else 1 + (front if len(groups) == len(panes) else front // GROUP_TABS)
    others = [_small_multiples(panes[:GROUP_TABS])] if len(panes) > 1 else []
    tabs = rrb.Tabs(_fleet(), *groups, *others, active_tab=in_front)
    return rrb.Blueprint(
        rrb.Horizontal(left, tabs, column_shares=[1.1, 3]),
        rrb.TimePanel(state="collapsed", timeline=TIMELINE, play_state="following"),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        auto_layout=False,
        auto_views=False,
    )


def _groups(tabs: Sequence[rrb.Container], front: int | None) -> list[rrb.Container]:
    """Tabs as they are, or by the dozen, that with number ``front`` open: more side by side nobody can read."""
    if len(tabs) <= GROUP_TABS:
        return list(tabs)
    dozens = [(k, tabs[k : k + GROUP_TABS]) for k in range(0, len(tabs), GROUP_TABS)]
    return [
        rrb.Tabs(
            *some,
            active_tab=front - k if front is not None and 0 <= front - k < len(some) else 0,
            name=f"{k + 1} to {k + len(some)}",
        )
        for k, some in dozens
    ]


def _fleet() -> rrb.Spatial2DView:
    bounds = rrb.VisualBounds2D(x_range=[0.0, WIDTH], y_range=[-5.0 * ROW, STRETCH * HEIGHT])
    return rrb.Spatial2DView(origin="/fleet", name="Fleet", visual_bounds=bounds)


def _tab(pane: Pane, legends: Mapping[str, rrb.Corner2D], modelled: bool) -> rrb.Horizontal:
    """One loop: its event, PV, residual and OP on one time axis; predictions, newest samples; the advice beside."""
    name, corner = plain(pane.loop, 60), legends.get(pane.loop, rrb.Corner2D.RightTop)
    other = rrb.Corner2D.RightTop if corner == rrb.Corner2D.RightBottom else rrb.Corner2D.RightBottom
    rows: list[tuple[float, Any]] = []
    if pane.end > pane.start:
        title = plain(pane.name) or f"{name}: SP, PV and model"
        rows = [
            (EVENT_ROWS, _chart(pane, (ONSET, SP, PV, MODEL), title, corner)),
            *([(RESIDUAL_ROWS, _chart(pane, (NOISE, RESIDUAL), f"{name}: PV less model", None))] * modelled),
            (OUTPUT_ROWS, _chart(pane, (ONSET_OP, OP), f"{name}: OP", other)),
        ]
    if pane.responses:
        charts = [_response(pane, response) for response in pane.responses]
        rows.append((RESPONSE_ROWS, rrb.Horizontal(*charts) if len(charts) > 1 else charts[0]))
    if pane.recent is None or pane.recent[1] > pane.recent[0]:
        words = "now" if pane.recent is None else "newest samples"
        strips = [_strip(pane, (SP, PV), f"{name}: {words}"), _strip(pane, (OP,), f"{name}: OP {words}")]
        # where it is all there is of the loop it has the room
        rows += [(STRIP_ROWS, rrb.Horizontal(*strips))] if rows else [(EVENT_ROWS, s) for s in strips]
    charts_of = rrb.Vertical(*(view for _, view in rows), row_shares=[share for share, _ in rows])
    page = rrb.TextDocumentView(origin=f"/{entity(pane.loop)}/page", name="Advice")
    return rrb.Horizontal(charts_of, page, column_shares=[2, 1], name=name)


def _small_multiples(panes: Sequence[Pane]) -> rrb.Grid:
    """All flagged loops' events side by side."""
    charts = [
        _chart(pane, (ONSET, SP, PV, MODEL), plain(pane.loop, 60), None)
        if pane.end > pane.start
        else _strip(pane, (SP, PV), plain(pane.loop, 60))
        for pane in panes
    ]
    return rrb.Grid(*charts, name="Side by side")


def _chart(pane: Pane, series: Sequence[str], name: str, legend: rrb.Corner2D | None) -> rrb.TimeSeriesView:
    """Chart of all of the loop's events that lie in the span of the one it is fitted to."""
    origin = f"/{entity(pane.loop)}/event"
    return _view(origin, [f"{origin}/{one}/**" for one in series], name, legend, _span(pane.start, pane.end))


def _response(pane: Pane, response: Response) -> rrb.TimeSeriesView:
    origin = f"/{entity(pane.loop)}/response/{response.kind}"
    contents = [f"{origin}/{one}" for one in (RESPONSE_SP, TODAY, BAND, NEW)]
    corner = rrb.Corner2D.RightBottom if response.kind == "setpoint" else rrb.Corner2D.RightTop
    return _view(origin, contents, plain(response.name), corner, _span(response.start, response.end))


def _strip(pane: Pane, series: Sequence[str], name: str) -> rrb.TimeSeriesView:
    """Chart of what the loop does now, or did last."""
    origin = f"/{entity(pane.loop)}/live"
    span = _recent(pane) if pane.recent is None else _span(*pane.recent)
    return _view(origin, [f"{origin}/{one}" for one in series], name, rrb.Corner2D.LeftTop, span)


def _view(
    origin: str, contents: Sequence[str], name: str, legend: rrb.Corner2D | None, span: dict[str, Any]
) -> rrb.TimeSeriesView:
    return rrb.TimeSeriesView(
        origin=origin,
        contents=contents,
        name=name,
        plot_legend=rrb.PlotLegend(legend, visible=legend is not None),
        interaction=rrb.PlotInteraction(tooltip_mode="All"),
        **span,
    )


def _span(first: int, last: int) -> dict[str, Any]:
    """Axis and data from one time to another [ns], with some air. Without a span: all there is."""
    if last <= first:
        return {}
    air = int(MARGIN_SHARE * (last - first))
    absolute = rrb.TimeRangeBoundary.absolute
    return _between(absolute(nanos=first - air), absolute(nanos=last + air))


def _recent(pane: Pane) -> dict[str, Any]:
    """Axis and data: the last window's length before the cursor, at least ``LIVE_SPAN_S``."""
    seconds = max(LIVE_SPAN_S, (pane.end - pane.start) / 1e9)
    relative = rrb.TimeRangeBoundary.cursor_relative
    return _between(relative(seconds=-seconds), relative())


def _between(start: rrb.TimeRangeBoundary, end: rrb.TimeRangeBoundary) -> dict[str, Any]:
    return {
        "axis_x": rrb.TimeAxis(view_range=rr.TimeRange(start=start, end=end)),
        "time_ranges": rrb.VisibleTimeRange(TIMELINE, start=start, end=end),
    }
