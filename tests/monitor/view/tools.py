"""The view as a command, and where it can run."""

from __future__ import annotations

import subprocess
import sys
from typing import Any

import pytest

from monitor.contract.evidence import Answers, Fleet, Pane, Scale, Step
from tests.support.places import ROOT
from tests.support.waiting import PATIENCE

LINUX = sys.platform.startswith("linux")
needs_rerun = pytest.mark.skipif(not LINUX, reason="looks at processes in /proc")


def command(*arguments: str) -> subprocess.CompletedProcess[str]:
    """Run the command by itself."""
    line = [sys.executable, "-m", "monitor", "view", *arguments]
    return subprocess.run(line, cwd=ROOT, capture_output=True, text=True, timeout=PATIENCE, check=False)


class Sketch:
    """Stands for the picture: counts."""

    def __init__(self) -> None:
        self.now = 1
        self.windows: list[str] = []
        self.scales: list[Scale] = []
        self.answered: list[tuple[Answers, Step]] = []
        self.fleets: list[Fleet] = []
        self.trends: list[str] = []
        self.lines: list[str] = []
        self.pages: dict[str | None, str] = {}
        self.layouts: list[tuple[list[Pane], str | None]] = []

    def window(self, window: Any, scale: Scale) -> None:
        self.windows.append(window.loop)
        self.scales.append(scale)

    def answers(self, answers: Answers, step: Step) -> None:
        self.answered.append((answers, step))

    def trend(self, trend: Any, _scale: Scale) -> None:
        self.trends.append(trend.loop)

    def fleet(self, loops: Fleet) -> None:
        self.fleets.append(loops)

    def log(self, text: str, _level: str, _time: int | None) -> None:
        self.lines.append(text)

    def page(self, text: str, loop: str | None = None) -> None:
        self.pages[loop] = text

    def layout(self, shown: list[Pane], active: str | None = None) -> None:
        self.layouts.append((shown, active))
