"""The view as a process: over Zenoh, with Rerun's programs; nothing of it can hurt the monitor or stay behind."""

from __future__ import annotations

import itertools
import os
import signal
import subprocess
import sys
import urllib.request
from pathlib import Path

import numpy as np
import psutil
import pytest

from monitor.adapters.rerun_view import series
from monitor.view.process import start_view
from tests.monitor.view.tools import LINUX, command, needs_rerun
from tests.support.fake_monitor import FakeMonitor, assessment, window_payload
from tests.support.places import ROOT
from tests.support.processes import children, gone
from tests.support.recordings import read, texts
from tests.support.waiting import PATIENCE, until


@pytest.mark.slow
def test_late_view_gets_the_current_state(tmp_path: Path, fake: FakeMonitor) -> None:
    """All was said before the view began: it asks, and records pages and windows of the flagged loops."""
    flagged = [loop for loop in fake.loops if loop.verdict == "retune"]
    view = start_view(fake.endpoint, "none", tmp_path / "late.rrd")
    try:
        until(lambda: {f"window/{loop.id}" for loop in flagged} <= fake.asked)
        assert view.url == ""  # nothing to open
        fake.health()
        drawn = [series.of_event(series.entity(loop.name), series.PV, loop.id).encode() for loop in flagged]
        until(lambda: all(path in (tmp_path / "late.rrd").read_bytes() for path in drawn))
    finally:
        view.stop()
    found = read(tmp_path / "late.rrd")
    for loop in flagged:
        _, values = found["/" + series.of_event(series.entity(loop.name), series.PV, loop.id)]
        np.testing.assert_array_equal(values, loop.columns["pv"])
    pages = texts(tmp_path / "late.rrd", "/overview")
    assert any("**4** to retune" in page and "**1** good" in page for page in pages)


def test_live_view_draws_what_is_said(tmp_path: Path, fake: FakeMonitor) -> None:
    """Suggestion, window and trend of a loop that is flagged while the view runs."""
    loop = fake.loops[0]
    fake.silent = True
    view = start_view(fake.endpoint, "none", tmp_path / "live.rrd")
    try:
        assert view.url == ""
        until(lambda: fake.heard(f"{loop.key}/suggestion"))

        def asked() -> bool:
            fake.tell(loop)  # again and again: what is put may be dropped where the machine is busy
            return f"window/{loop.id}" in fake.asked

        until(asked)
        steps = itertools.count()
        base = f"/{series.entity(loop.name)}/live/{series.PV}"

        def drawn() -> bool:
            fake.go_on(loop, 4000 + 10 * next(steps), 10)
            return base[1:].encode() in (tmp_path / "live.rrd").read_bytes()

        until(drawn)
    finally:
        view.stop()
    assert read(tmp_path / "live.rrd")[base][1].size >= 10
    log = texts(tmp_path / "live.rrd", "/log")
    assert any("LIC-101: retune" in line for line in log), log


@pytest.mark.slow
def test_single_event(tmp_path: Path, fake: FakeMonitor) -> None:
    """``--event`` shows one event of the history, even of a good loop; an unknown one is an error."""
    loop = next(loop for loop in fake.loops if loop.verdict == "good")
    file = tmp_path / "e.rrd"
    options = ["--connect", fake.endpoint, "--view", "none", "--save", str(file)]
    process = subprocess.Popen(
        [sys.executable, "-m", "monitor", "view", *options, "--event", loop.id], cwd=ROOT
    )
    try:
        until(lambda: f"window/{loop.id}" in fake.asked)
        until(lambda: series.ONSET_OP.encode() in file.read_bytes())
    finally:
        process.terminate()
        assert process.wait(PATIENCE) == 0
    names = "SP PV OP MODEL RESIDUAL ONSET ONSET_OP".split()
    base = series.entity(loop.name)
    assert set(read(file)) == {f"/{series.of_event(base, getattr(series, name), loop.id)}" for name in names}
    done = command(*options, "--event", "0123456789abcdef")
    assert done.returncode == 1
    assert done.stderr.count("\n") == 1
    assert "knows no event" in done.stderr


@pytest.mark.slow
@pytest.mark.skipif(not LINUX, reason="stops a process by signal")
def test_stalled_view_does_not_delay_a_publisher(tmp_path: Path, fake: FakeMonitor) -> None:
    """While the view is stopped, thousands of puts each take no time; afterwards it can still be ended."""
    loop = fake.loops[0]
    view = start_view(fake.endpoint, "none", tmp_path / "s.rrd")
    try:
        until(lambda: f"window/{loop.id}" in fake.asked)
        os.kill(view.pid, signal.SIGSTOP)
        window, fact = window_payload(loop), assessment(loop)
        took = [fake.put(f"{loop.key}/window", window) for _ in range(500)]
        took += [fake.put(f"{loop.key}/assessment", fact) for _ in range(3000)]
        assert max(took) < 0.05
        os.kill(view.pid, signal.SIGCONT)
    finally:
        view.stop()
    assert not view.alive()


@needs_rerun
def test_stop_leaves_no_process(fake: FakeMonitor) -> None:
    """The web page answers on loopback; after stop neither the view nor Rerun's server run."""
    view = start_view(fake.endpoint, "web")
    assert view.url.startswith("http://127.0.0.1:")
    with urllib.request.urlopen(view.url, timeout=PATIENCE) as page:
        assert page.status == 200
    servers = children(view.pid)
    assert len(servers) == 1
    assert all(address.startswith("127.0.0.1:") for address in listening(servers[0]))
    view.stop()
    assert not view.alive()
    assert all(gone(pid) for pid in servers)
    view.stop()


def listening(pid: int) -> list[str]:
    """Addresses that a process listens at."""
    listens = [c for c in psutil.Process(pid).net_connections("tcp") if c.status == psutil.CONN_LISTEN]
    assert listens
    return [f"{c.laddr.ip}:{c.laddr.port}" for c in listens]


@pytest.mark.slow
@needs_rerun
@pytest.mark.parametrize("how", ["killed", "server stalled", "server killed"])
def test_whatever_dies_takes_the_rest_along(fake: FakeMonitor, how: str) -> None:
    view = start_view(fake.endpoint, "web")
    assert view.url
    server = children(view.pid)[0]
    if how == "killed":
        os.kill(view.pid, signal.SIGKILL)
    elif how == "server stalled":
        os.kill(server, signal.SIGSTOP)
        fake.tell(fake.loops[0])
        view.stop()
    else:
        os.kill(server, signal.SIGKILL)
    until(lambda: not view.alive() and gone(server))
    fake.tell(fake.loops[0])
    view.stop()


@pytest.mark.slow
@needs_rerun
def test_view_ends_with_its_parent(fake: FakeMonitor) -> None:
    """Even when the parent is killed."""
    code = (
        "import sys, time; from monitor.view.process import start_view\n"
        f"v = start_view({fake.endpoint!r}, 'web'); print(v.pid, v.url, flush=True); time.sleep(60)"
    )
    parent = subprocess.Popen([sys.executable, "-c", code], cwd=ROOT, stdout=subprocess.PIPE, text=True)
    assert parent.stdout is not None
    pid, url = parent.stdout.readline().split()
    assert url.startswith("http://127.0.0.1:")
    servers = children(int(pid))
    parent.kill()
    parent.wait()
    parent.stdout.close()
    until(lambda: gone(int(pid)) and all(gone(s) for s in servers))
