"""What the view draws on."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Protocol

from monitor.contract.evidence import Answers, Fleet, Pane, Scale, Step, Trend, Window

Draw = Callable[["Drawing"], None]
"""What draws."""


class ViewError(RuntimeError):
    """Nothing can be shown; one line that says why."""


class Drawing(Protocol):
    """A picture; ``monitor.adapters.rerun_view.picture`` is one."""

    now: int
    """Latest time drawn [ns since 1970], 0 before any."""

    def window(self, window: Window, scale: Scale) -> None:
        """Draw an event's evidence."""

    def answers(self, answers: Answers, step: Step) -> None:
        """Draw predicted responses to a step."""

    def trend(self, trend: Trend, scale: Scale) -> None:
        """Draw new samples of a loop."""

    def fleet(self, loops: Fleet) -> None:
        """Draw all loops in one picture."""

    def log(self, text: str, level: str, time: int | None) -> None:
        """Write a line into the log, as of ``time`` [ns since 1970]; None: now."""

    def page(self, text: str, loop: str | None = None) -> None:
        """Show markdown as the page of a loop, or as the overview."""

    def layout(self, shown: Sequence[Pane], active: str | None = None) -> None:
        """Lay out anew: a tab for each of ``shown``, ``active`` in front."""
