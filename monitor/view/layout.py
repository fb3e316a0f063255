"""When to lay out anew: each time may cost the reader his tab and his zoom."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from monitor.contract.evidence import Pane, Window

from .drawing import Drawing

QUIET_TICKS = 1200
"""Ticks (five minutes) for which the reader keeps his tab and his zoom, while only the evidence changes."""


class Layout:
    """Sends a layout where the loops have changed, and in quiet times where their evidence has."""

    def __init__(self, picture: Drawing) -> None:
        self._picture = picture
        self._wanted: dict[str, Window] = {}
        """The event that each loop's charts should be fitted to."""
        self._panes: dict[str, Pane] = {}
        """What was sent last."""
        self._ids: dict[str, str] = {}
        self._started: bool | None = None
        self._ticks, self._count = 0, 0

    def fitted(self, name: str) -> str:
        """Id of the event that the loop's charts are fitted to, or empty."""
        return self._ids.get(name, "")

    def update(
        self, shown: Sequence[str], windows: Mapping[str, Window], evidence: Mapping[str, str]
    ) -> None:
        """Look once a tick.

        Parameters
        ----------
        shown
            The loops, in the order of their tabs.
        windows
            The window that is held of each, where there is one.
        evidence
            Id of the event that stands for each.
        """
        self._wanted = {name: window for name, window in self._wanted.items() if name in shown}
        for name, window in windows.items():
            if name not in self._wanted or window.id == evidence.get(name):
                self._wanted[name] = window
        self._ticks += 1
        ids = {name: window.id for name, window in self._wanted.items()}
        others = set(shown) != set(self._panes)
        changed = others or set(ids) != set(self._ids) or self._started != (self._picture.now > 0)
        if not changed and (ids == self._ids or self._ticks < QUIET_TICKS):
            return
        if self._ticks < min(QUIET_TICKS, 2 * self._count):
            return
        fresh = next((name for name in shown if name not in self._panes), None)
        names = list(shown if others else self._panes)
        self._panes = {name: _pane(name, self._wanted.get(name)) for name in names}
        self._ids, self._started, self._ticks = ids, self._picture.now > 0, 0
        self._count += 1
        self._picture.layout(list(self._panes.values()), fresh or next(iter(names), None))


def _pane(name: str, window: Window | None) -> Pane:
    return Pane(name, 0, 0) if window is None else Pane(name, int(window.time[0]), int(window.time[-1]))
