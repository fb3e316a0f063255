"""How an audit is run: what a user may choose, each with its default."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import UTC
from zoneinfo import ZoneInfo

from monitor.adapters.historian.clock import zone_of
from monitor.adapters.historian.mapping import ExportMapping, given_mapping
from monitor.adapters.historian.merge import Span
from monitor.contract.times import given_time


@dataclass(frozen=True, slots=True, kw_only=True)
class AuditSettings:
    """Settings of an audit; the options of ``loopsight audit``."""

    jobs: int = 1
    """Processes. Their number changes nothing in the result."""
    since: str | None = None
    """First time: ISO text, or seconds where the data have numbers."""
    until: str | None = None
    """First time not wanted any more."""
    tz: str | None = None
    """Zone of times that name none; None: UTC."""
    time_unit: str | None = None
    """Unit of numeric times: ``s``, ``ms``, ``us``, ``ns`` or ``excel``; None: told by their range."""
    time_format: str | None = None
    """Order of day, month and year in times that are text, e.g. ``%d/%m/%Y %H:%M:%S``; None: told by the data."""
    map: str | None = None
    """File that says how the exports are to be read (`loopsight import` writes one); None: they are recognised."""
    resume: bool = False
    """Take over what an earlier audit of the same data, stopped half way, has stored in its folder."""
    scheduler: str | None = None
    """Address of a Dask scheduler that runs the tasks; its workers see the files under the same paths."""

    since_audit: str | None = None
    """Folder of the last audit of these loops: page one of the report says what has changed since."""

    def given(self) -> ExportMapping:
        """Return what is said of how the exports are to be read.

        Raises
        ------
        ValueError
            The file, or the format of times, is not acceptable: one line that says why.
        OSError
            The file cannot be read.
        """
        return given_mapping(self.map, self.time_format)

    def span(self) -> Span:
        """Return which samples are wanted, and how their times are read.

        Raises
        ------
        ValueError
            A time or a zone is none: one line that names it.
        """
        zone = zone_of(self.tz or "UTC")
        return Span(_time("--since", self.since, zone), _time("--until", self.until, zone), zone)


def _time(option: str, text: str | None, zone: ZoneInfo | None) -> int | None:
    if text is None:
        return None
    try:
        return given_time(text, zone or UTC)
    except ValueError:
        raise ValueError(
            f"{option}: {text!r}, expected ISO text, e.g. 2026-11-22T10:00:00, or seconds"
        ) from None
