"""Every command: help at once, and every error one line with exit code 2."""

from __future__ import annotations

import subprocess
import sys

import pytest

from tests.monitor.cli.tools import run


@pytest.mark.parametrize(
    "arguments",
    [
        ("demo", "--seconds", "soon"), ("demo", "--view", "tv"), ("demo", "--scenario", "x"),
        ("demo", "--speed", "0"),
        ("simulate", "--scenario", "x"), ("simulate", "--loops", "-1"),
        ("simulate", "--loops", "2", "--scenario", "demo"),
        ("simulate", "--plant", "missing.toml"), ("simulate", "--payload", "x"),
        ("monitor", "--config", "missing.toml"), ("monitor", "--loops", "missing.csv", "--state", "{tmp}"),
        ("monitor", "--listen", "nonsense", "--state", "{tmp}"), ("monitor", "--state", "{tmp}/file"),
        ("audit", "missing", "--loops", "missing.csv", "--out", "{tmp}"), ("check", "missing.csv"),
        ("view", "missing.rrd"),
        ("tune", "--rule", "x", "--gain", "1", "--dead-time", "1"),
    ],
    ids=" ".join,
)  # fmt: skip
def test_wrong_use_is_one_line(tmp_path, arguments):
    """Values that are none, files that are missing: exit 2, on stderr, no traceback."""
    (tmp_path / "file").write_text("")
    done = run(*(a.replace("{tmp}", str(tmp_path)) for a in arguments))
    assert done.returncode == 2, (done.stdout, done.stderr)
    assert len(done.stderr.splitlines()) == 1, done.stderr
    assert "Traceback" not in done.stderr


def test_output_that_nobody_reads_is_no_error():
    """`loopsight tune --list | true`."""
    command = [sys.executable, "-m", "monitor", "tune", "--list"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as started:
        assert started.stdout is not None
        assert started.stderr is not None
        started.stdout.close()
        assert started.stderr.read() == ""
    assert started.returncode in {0, 1}  # click's own answer to a broken pipe
