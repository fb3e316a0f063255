"""The demo as a command."""

from __future__ import annotations

import sys


def command(*options: str) -> list[str]:
    return [sys.executable, "-m", "monitor", "demo", "--view", "none", *options]
