"""The events that the view remembers: what was judged of them, their windows, and which stands for which loop."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Iterator, Mapping, Sequence
from typing import TypeVar

from monitor.contract.evidence import Window

from .pages import Row
from .selection import SHOWN_LOOPS

EVENTS = 2000
"""Assessments kept for the pages of the loops shown."""
WINDOWS = 4 * SHOWN_LOOPS
"""One a loop."""

T = TypeVar("T")


class Evidence:
    """Bounded: what came first is forgotten first."""

    def __init__(self) -> None:
        self.stands: dict[str, str] = {}
        """Id of the event that stands for each loop: what its suggestion rests on, else the best remembered."""
        self._assessments: OrderedDict[str, Row] = OrderedDict()
        self._windows: OrderedDict[str, Window] = OrderedDict()
        """The newest window of each loop that was asked for."""
        self._drawn: OrderedDict[str, None] = OrderedDict()
        self._cited: set[str] = set()
        """Loops whose suggestion has named its evidence."""

    def assessment(self, event: str) -> Row | None:
        """Return what was judged of an event, if that is remembered."""
        return self._assessments.get(event)

    def keep(self, assessment: Row) -> None:
        """Remember what was judged of an event."""
        _keep(self._assessments, str(assessment["id"]), assessment, EVENTS)

    def cite(self, loop: str, event: str) -> None:
        """Let an event stand for a loop: its suggestion rests on it."""
        self.stands[loop] = event
        self._cited.add(loop)

    def prefer(self, loop: str, assessment: Row) -> bool:
        """Let an event of the past stand for a loop where it is its best evidence; whether it does."""
        if loop in self._cited:
            return False
        best = self._assessments.get(self.stands.get(loop, ""))
        if best is not None and _worth(assessment) <= _worth(best):
            return False
        self.stands[loop] = str(assessment["id"])
        return True

    def forget(self, loop: str) -> None:
        """Let no event stand for a loop any more."""
        self.stands.pop(loop, None)
        self._cited.discard(loop)

    def hold(self, window: Window) -> None:
        """Hold the window that stands for its loop, or the newest."""
        held = self._windows.get(window.loop)
        if held is None or window.onset >= held.onset or window.id == self.stands.get(window.loop):
            _keep(self._windows, window.loop, window, WINDOWS)

    def windows(self, loops: Sequence[str]) -> Mapping[str, Window]:
        """Return the windows that are held of these loops."""
        return {name: self._windows[name] for name in loops if name in self._windows}

    def undrawn(self, loops: Sequence[str]) -> Iterator[Window]:
        """Yield those of their windows that were not yielded before."""
        for window in self.windows(loops).values():
            if window.id not in self._drawn:
                _keep(self._drawn, window.id, None, EVENTS)
                yield window


def _worth(assessment: Row) -> tuple[bool, str]:
    return assessment.get("verdict") == "retune", str(assessment.get("start"))


def _keep(kept: OrderedDict[str, T], key: str, value: T, most: int) -> None:
    kept[key] = value
    kept.move_to_end(key)
    if len(kept) > most:
        kept.popitem(last=False)
