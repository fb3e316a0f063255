"""What an audit comes to, for whoever has five minutes: kinds of loops, jobs, and what was not judged. Plain facts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from .changes import Comparison
from .evidence import Answers, Window
from .records import Assessment, LoopRow

KINDS = ("good", "retune", "valve", "oscillating", "manual", "unclear")
"""What is to be done with a loop; each loop is of one kind."""
WITH_TREND = ("valve", "oscillating", "manual")
"""Kinds of loops whose newest samples are shown beside their events; of others, where there are none."""


@dataclass(frozen=True, slots=True)
class Job:
    """One thing to do."""

    loops: tuple[str, ...]
    kind: str
    """One of `KINDS`, of its first loop."""
    who: str
    title: str
    """In a few words."""
    what: str
    why: str
    benefit: str
    risk: str


@dataclass(frozen=True, slots=True)
class Remedy:
    """What would make loops judgeable that are not."""

    what: str
    why: str
    """Of the first of them."""
    loops: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Summary:
    """Page one."""

    counts: dict[str, int]
    """Loops by kind."""
    kinds: dict[str, str]
    """Kind of each loop."""
    jobs: tuple[Job, ...]
    """All of them, the most dangerous first."""
    remedies: tuple[Remedy, ...]
    """That for the most loops first."""
    coverage: float | None
    """Mean of the loops' share of time with good samples."""
    near_instability: int
    """Loops."""


@dataclass(frozen=True, slots=True)
class Contents:
    """What there is to be shown of an audit."""

    about: Mapping[str, Any]
    """`audit.json`."""
    rows: Sequence[LoopRow]
    """Worst first."""
    events: Sequence[Assessment]
    windows: Sequence[Window]
    answers: Sequence[Answers]
    summary: Summary
    since: Comparison | None = None
    """What has changed since the last audit, where one is given."""
