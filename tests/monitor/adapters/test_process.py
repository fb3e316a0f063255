"""Children that end with us, and being told to stop: each in a process of its own."""

from __future__ import annotations

import signal
import subprocess
import sys
import time

import pytest

from monitor.adapters.process import LINUX, Hangup, end

pytestmark = pytest.mark.skipif(not LINUX, reason="stops processes by signal")

HEAD = "import os, signal, sys, time; from monitor.adapters.process import Stop\n"
READY = "print('ready', flush=True)"


def started(code: str) -> subprocess.Popen[str]:
    """A process that has said that it is ready."""
    line = [sys.executable, "-c", HEAD + code]
    process = subprocess.Popen(line, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    assert process.stdout is not None
    assert process.stdout.readline() == "ready\n"
    return process


def ended(process: subprocess.Popen[str]) -> tuple[int, str, str]:
    """Its exit code and what it said."""
    said, complained = process.communicate(timeout=60)
    return process.returncode, said, complained


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_told_to_stop(number):
    """Twice, too: what is held is finished, exit 0."""
    code = f"""
with Stop() as stop:
    {READY}
    stop.wait()
os.kill(os.getpid(), {int(number)})
print('finished')
"""
    process = started(code)
    process.send_signal(number)
    assert ended(process) == (0, "finished\n", "")


@pytest.mark.parametrize("code", [0, 3])
def test_what_hangs_is_ended_by_force(code):
    """With the exit code that was asked for."""
    process = started(f"""
with Stop(0.1, {code}) as stop:
    {READY}
    while True: time.sleep(1)
""")
    process.send_signal(signal.SIGTERM)
    assert ended(process) == (code, "", "")


def test_an_error_is_no_orderly_end():
    """What hangs after an error is ended with exit code 1."""
    process = started(f"""
try:
    with Stop(0.1, 0) as stop:
        {READY}
        stop.wait()
        raise OSError
except OSError:
    while True: time.sleep(1)
""")
    process.send_signal(signal.SIGTERM)
    assert ended(process) == (1, "", "")


def test_what_runs_is_broken_off():
    """Where nothing is lost with it."""
    process = started(f"""
with Stop() as stop:
    with stop.breaking_off():
        {READY}
        while True: time.sleep(1)
    print(stop.is_set())
""")
    process.send_signal(signal.SIGTERM)
    assert ended(process) == (0, "True\n", "")


def test_what_swallows_the_breaking_off_is_ended():
    """A compiler does; it is no failure."""
    process = started(f"""
with Stop() as stop, stop.breaking_off(0.1):
    {READY}
    while True:
        try:
            time.sleep(1)
        except BaseException:
            pass
""")
    process.send_signal(signal.SIGTERM)
    assert ended(process) == (0, "", "")


def test_with_its_parent():
    """One whose parent is no longer the one that it was told ends at its next look."""
    process = started(f"""
with Stop(parent=1) as stop:
    {READY}
    print(stop.wait(60), stop.is_set())
""")
    assert ended(process) == (0, "True True\n", "")


def test_a_child_that_does_not_end_is_ended():
    """By force, also one that is stopped; twice is harmless."""
    process = started(f"""
signal.signal(signal.SIGTERM, signal.SIG_IGN)
{READY}
time.sleep(600)
""")
    process.send_signal(signal.SIGSTOP)
    began = time.monotonic()
    end(process, 0.1)
    end(process)
    assert process.returncode == -signal.SIGKILL
    assert time.monotonic() - began < 60
    process.communicate()


@pytest.mark.skipif(not hasattr(signal, "SIGHUP"), reason="no SIGHUP on this system")
def test_a_hangup_is_noted_once_until_it_is_taken() -> None:
    """Twice before it is taken is once; outside of `with` the handler of before holds."""
    before = signal.getsignal(signal.SIGHUP)
    with Hangup() as hangup:
        assert not hangup.take()
        signal.raise_signal(signal.SIGHUP)
        signal.raise_signal(signal.SIGHUP)
        assert hangup.take()
        assert not hangup.take()
    assert signal.getsignal(signal.SIGHUP) == before
