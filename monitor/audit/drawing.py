"""An audit's folder to what is shown of it: what its tables hold, summed up; drawn as a report beside them."""

from __future__ import annotations

from pathlib import Path

from monitor.adapters.audit_folder import AuditFolder, read_audit
from monitor.adapters.files import write_text
from monitor.adapters.tables import read_evidence
from monitor.compare.between import compare
from monitor.contract.summary import Contents
from monitor.report.draw import draw

from .summary import summary_of

REPORT_FILE = "report.html"


def draw_report(out: Path, last: AuditFolder | None = None) -> Path:
    """Write ``report.html`` from the tables in an audit's folder; the same tables give the same bytes.

    Parameters
    ----------
    last
        The last audit of these loops: page one says what has changed since.

    Raises
    ------
    OSError
        A file cannot be read, or the report not be written.
    ValueError
        The folder holds no audit: one line that says what is missing.
    """
    text = draw(contents_of(out, last))
    write_text(out / REPORT_FILE, text)
    return out / REPORT_FILE


def contents_of(out: Path, last: AuditFolder | None = None) -> Contents:
    """Return what there is to be shown of the audit in a folder, with what has changed since the ``last`` one.

    Raises
    ------
    OSError
        A file cannot be read.
    ValueError
        The folder holds no audit: one line that says what is missing.
    """
    audit = read_audit(out)
    windows, answers = read_evidence(out)
    since = None if last is None else compare(last, audit)
    return Contents(audit.about, audit.rows, audit.events, windows, answers, summary_of(audit.rows), since)
