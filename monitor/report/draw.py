"""An audit's facts to one HTML page that opens from disk: text, styles, scripts and evidence inside, no network."""

from __future__ import annotations

from typing import Any

from monitor.contract.figures import MEANINGS
from monitor.contract.looks import LOOKS
from monitor.contract.records import LoopRow, by_loop
from monitor.contract.summary import KINDS, WITH_TREND, Contents
from monitor.contract.text import visible

from .changes import since_of
from .charts import charts_of
from .fleet import fleet_of
from .page import as_json, asset, environment, sha256
from .section import health_of, section_of
from .words import facts_of, number

SHOWN_JOBS, LISTED_JOBS, SHOWN_REMEDIES, SHOWN_NAMES = 10, 100, 8, 6
"""On page one; jobs that are listed a click away, of which all others follow in the table of loops; and so on."""
MOST_WITH_CHARTS = 800
"""Loops whose evidence is inside, the worst: some 15 kB each, so that a page of any fleet opens in 3 s. The section of
any other flagged loop has its words and settings, and the files have all."""
SECTIONS_WITH_ALL, ALL_WINDOWS, FEW_WINDOWS = 300, 4, 2
"""Worst loops of which all kept windows are inside, how many these are, and how many of the others, the newest."""
SHOWN_EVENTS = 8
"""Newest events in a section's table; `events.parquet` has all."""


def draw(contents: Contents) -> str:
    """Return the page; the same contents give the same text."""
    summary, rows = contents.summary, contents.rows
    sections = _sections(contents)
    index = [_index_row(row, summary.kinds[row.loop], row.loop in sections) for row in rows]
    script, plot = (asset(name) for name in ("report.js", "uPlot.iife.min.js"))
    page = (
        environment()
        .get_template("page.html.j2")
        .render(
            facts=facts_of(contents.about),
            since=None if contents.since is None else since_of(contents.since),
            summary=summary,
            kinds=[(kind, LOOKS[kind]) for kind in KINDS],
            looks=LOOKS,
            jobs=summary.jobs[:SHOWN_JOBS],
            more_jobs=summary.jobs[SHOWN_JOBS:LISTED_JOBS],
            unlisted_jobs=max(len(summary.jobs) - LISTED_JOBS, 0),
            remedies=summary.remedies[:SHOWN_REMEDIES],
            more_remedies=summary.remedies[SHOWN_REMEDIES:],
            shown_names=SHOWN_NAMES,
            fleet=fleet_of(rows, summary.kinds),
            n_loops=len(rows),
            n_sections=len(sections),
            n_charts=min(len(sections), MOST_WITH_CHARTS),
            index=as_json(index),
            meanings=as_json(MEANINGS),
            sections=[as_json(section) for section in sections.values()],
            styles=[asset(name) for name in ("uPlot.min.css", "report.css")],
            scripts=[plot, script],
            policy=" ".join(f"'sha256-{sha256(text)}'" for text in (plot, script)),
        )
    )
    return page + "\n"


def _sections(contents: Contents) -> dict[str, dict[str, Any]]:
    """Return the sections of the loops that have something to be looked at: markup and charts, by loop."""
    template = environment().get_template("loop.html.j2")
    events = by_loop(contents.events)
    windows = by_loop(contents.windows)
    answers = by_loop(contents.answers)
    kinds = contents.summary.kinds
    jobs = {name: job for job in contents.summary.jobs for name in job.loops}
    wanted = [r for r in contents.rows if r.loop in windows or kinds[r.loop] != "good"]
    found: dict[str, dict[str, Any]] = {}
    for row in wanted:
        own = events.get(row.loop, [])
        html = template.render(
            section_of(row, own[-SHOWN_EVENTS:][::-1], jobs.get(row.loop)),
            look=LOOKS[kinds[row.loop]],
            more_events=max(len(own) - SHOWN_EVENTS, 0),
        )
        most = ALL_WINDOWS if len(found) < SECTIONS_WITH_ALL else FEW_WINDOWS
        within = len(found) < MOST_WITH_CHARTS
        own_windows = windows.get(row.loop, [])
        judged = [w for w in own_windows if w.id][-most:]
        if not judged or kinds[row.loop] in WITH_TREND:
            judged += [w for w in own_windows if not w.id]
        shown = (judged, answers.get(row.loop, [])) if within else ([], [])
        charts = charts_of(own, *shown)
        lean = "\n".join(line for line in map(str.strip, html.splitlines()) if line)
        found[row.loop] = {"html": lean, "health": health_of(row), **charts}
    return found


def _index_row(row: LoopRow, kind: str, has_section: bool) -> list[Any]:
    """Return a loop's line of the table, in the order that `report.js` knows."""
    indices = [ci for ci in (row.ci_setpoint, row.ci_load) if ci is not None]
    return [
        visible(row.loop),
        kind,
        number(min(indices, default=None)),
        number(row.ms),
        row.events,
        ", ".join(row.flags),
        visible(row.reason),
        visible(row.action),
        int(has_section),
    ]
