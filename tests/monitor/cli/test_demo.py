"""The command `loopsight demo`: what it refuses."""

from __future__ import annotations

import subprocess

from tests.monitor.service.tools import command
from tests.support.waiting import PATIENCE


def test_a_folder_that_cannot_be_written_is_one_line(tmp_path):
    """Said before the demo runs, or at its end, but never as a traceback."""
    (tmp_path / "x").write_text("")
    done = subprocess.run(
        command("--seconds", "1", "--out", str(tmp_path / "x" / "y")),
        capture_output=True,
        text=True,
        check=False,
        timeout=PATIENCE,
    )
    assert done.returncode == 2
    assert len(done.stderr.splitlines()) == 1
