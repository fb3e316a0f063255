"""The command as a process."""

from __future__ import annotations

import subprocess
import sys

from tests.support.waiting import PATIENCE


def run(*arguments: str, timeout: float = PATIENCE) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "monitor", *arguments],
        capture_output=True,
        text=True,
        check=False,
        timeout=timeout,
    )


def refused(*arguments: str, names: str = "") -> str:
    """Run what is wrong; return its one line."""
    done = run(*arguments)
    assert done.returncode == 2, (done.stdout, done.stderr)
    assert done.stdout == ""
    (line,) = done.stderr.splitlines()
    assert line.startswith("loopsight: ")
    assert "Traceback" not in line
    assert names in line
    return line
