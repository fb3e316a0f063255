"""An audit's folder to what is shown of it: what its tables hold, summed up; drawn as a report beside them."""

from __future__ import annotations

import json
from pathlib import Path

from monitor.adapters.files import write_text
from monitor.adapters.tables import EVENTS_FILE, LOOPS_FILE, read_evidence, read_records
from monitor.contract.records import Assessment, LoopRow
from monitor.contract.summary import Contents
from monitor.report.draw import draw

from .summary import summary_of

REPORT_FILE, ABOUT_FILE = "report.html", "audit.json"


def draw_report(out: Path) -> Path:
    """Write ``report.html`` from the tables in an audit's folder; the same tables give the same bytes.

    Raises
    ------
    OSError
        A file cannot be read, or the report not be written.
    ValueError
        The folder holds no audit: one line that says what is missing.
    """
    text = draw(contents_of(out))
    write_text(out / REPORT_FILE, text)
    return out / REPORT_FILE


def contents_of(out: Path) -> Contents:
    """Return what there is to be shown of the audit in a folder.

    Raises
    ------
    OSError
        A file cannot be read.
    ValueError
        The folder holds no audit: one line that says what is missing.
    """
    for name in (LOOPS_FILE, EVENTS_FILE, ABOUT_FILE):
        if not (out / name).is_file():
            raise ValueError(f"{out}: no {name}, expected the folder of an audit (--out)")
    try:
        about = json.loads((out / ABOUT_FILE).read_text(encoding="utf-8"))
    except ValueError as error:
        raise ValueError(f"{out / ABOUT_FILE}: no JSON: {error}") from None
    rows = read_records(out / LOOPS_FILE, LoopRow)
    events = read_records(out / EVENTS_FILE, Assessment)
    windows, answers = read_evidence(out)
    return Contents(about, rows, events, windows, answers, summary_of(rows))
