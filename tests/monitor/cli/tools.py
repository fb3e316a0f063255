"""The command line, within this process (a second or two are saved that the libraries need to load) or by itself."""

from __future__ import annotations

import io
import re
import signal
import subprocess
import sys
from contextlib import redirect_stderr, redirect_stdout
from unittest import mock

from monitor.cli.main import main
from tests.support.waiting import PATIENCE


def run(*arguments: str) -> subprocess.CompletedProcess[str]:
    """Run the command line here; what it wrote, and its exit code."""
    out, err, code = io.StringIO(), io.StringIO(), 0
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        with (
            redirect_stdout(out),
            redirect_stderr(err),
            mock.patch.object(sys, "argv", ["loopsight", *arguments]),
        ):
            main()
    except SystemExit as end:
        code = int(end.code or 0)
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
    return subprocess.CompletedProcess(arguments, code, out.getvalue(), err.getvalue())


def started(*arguments: str) -> subprocess.CompletedProcess[str]:
    """Run the command line as a process of its own, to its end."""
    line = [sys.executable, "-m", "monitor", *arguments]
    return subprocess.run(line, capture_output=True, text=True, check=False, timeout=PATIENCE)


def refused(*arguments: str, names: str = "") -> str:
    """Run what is wrong; return its one line."""
    done = run(*arguments)
    assert done.returncode == 2, (done.stdout, done.stderr)
    assert done.stdout == ""
    (line,) = done.stderr.splitlines()
    assert re.match(r"loopsight( [a-z]+)?: ", line)
    assert "Traceback" not in line
    assert names in line
    return line
