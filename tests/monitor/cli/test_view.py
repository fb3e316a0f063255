"""The command `loopsight view`."""

from __future__ import annotations

import signal
import subprocess
import sys
import urllib.request
from pathlib import Path

import pytest

from monitor.adapters.rerun_view import picture as rerun_picture
from monitor.adapters.rerun_view import process as rerun_process
from monitor.cli.main import run
from monitor.contract.evidence import Scale
from monitor.view.process import ViewProcess
from monitor.wire.arrow import decode_window
from tests.monitor.view.tools import command, needs_rerun
from tests.support.fake_monitor import Loop, window_payload
from tests.support.places import ROOT
from tests.support.waiting import PATIENCE


@pytest.mark.parametrize(
    "arguments",
    [
        "",
        "missing.rrd",
        "pyproject.toml",
        "pyproject.toml --event x",
        "docs",
        "docs --view none",
        "--event 0123 --state nowhere",
        "--event 0123 --state docs --view none --save x.rrd",
        "--state docs",
        "--event a/**",
        "--connect nonsense",
        "--connect tcp/127.0.0.1:1 --view none",
        "--connect tcp/127.0.0.1:1 --save /nowhere/x.rrd",
        "--view hologram",
    ],
)
def test_wrong_use_is_one_line_and_exit_2(
    arguments: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(ROOT)
    assert run(["view", *arguments.split()]) == 2
    said = capsys.readouterr()
    assert said.out == ""
    assert said.err.count("\n") == 1
    assert said.err.startswith("loopsight view: ")


@pytest.mark.slow
def test_no_monitor_is_one_line(tmp_path: Path) -> None:
    port = rerun_process.free_ports(1)[0]
    done = command("--connect", f"tcp/127.0.0.1:{port}", "--view", "none", "--save", str(tmp_path / "x.rrd"))
    assert done.returncode == 1
    assert done.stderr.count("\n") == 1
    assert f"127.0.0.1:{port}" in done.stderr


def test_help_is_light() -> None:
    """``--help`` has an example and loads none of the heavy libraries."""
    heavy = "rerun", "zenoh", "pyarrow", "numpy"
    code = f"import sys, monitor.cli.view; print([m for m in {heavy} if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
    assert "Example: loopsight view" in command("--help").stdout


@needs_rerun
def test_recording_is_served(tmp_path: Path, loop: Loop) -> None:
    """``loopsight view FILE.rrd`` opens on loopback and ends on SIGINT with exit 0."""
    recording = rerun_picture.open_recording(None, tmp_path / "a.rrd")
    rerun_picture.Picture(recording).window(decode_window(window_payload(loop)), Scale())
    rerun_picture.close_recording(recording)
    line = [sys.executable, "-m", "monitor", "view", str(tmp_path / "a.rrd")]
    process = subprocess.Popen(line, cwd=ROOT, stdout=subprocess.PIPE, text=True)
    view = ViewProcess(process)
    try:
        with urllib.request.urlopen(view.url, timeout=PATIENCE) as page:
            assert page.status == 200
    finally:
        process.send_signal(signal.SIGINT)
    assert process.wait(PATIENCE) == 0
    view.stop()
