"""The view as a command, and where it can run."""

from __future__ import annotations

import subprocess
import sys

import pytest

from tests.support.places import ROOT
from tests.support.waiting import PATIENCE

LINUX = sys.platform.startswith("linux")
needs_rerun = pytest.mark.skipif(not LINUX, reason="looks at processes in /proc")


def command(*arguments: str) -> subprocess.CompletedProcess[str]:
    """Run the command by itself."""
    line = [sys.executable, "-m", "monitor.view.process", *arguments]
    return subprocess.run(line, cwd=ROOT, capture_output=True, text=True, timeout=PATIENCE, check=False)
