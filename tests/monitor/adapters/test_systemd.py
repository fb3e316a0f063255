"""A service manager that listens, on a path or in the abstract namespace; and none."""

from __future__ import annotations

import os
import socket
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from monitor.adapters.systemd import Manager

pytestmark = pytest.mark.skipif(not hasattr(socket, "AF_UNIX"), reason="needs AF_UNIX")


def abstract() -> str:
    if not sys.platform.startswith("linux"):
        pytest.skip("Linux alone has an abstract namespace")
    return f"@loopsight-test-{os.getpid()}"


@pytest.fixture(params=["path", "abstract"])
def listening(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[tuple[str, socket.socket]]:
    """Address as the environment gives it, and who listens there."""
    address = abstract() if request.param == "abstract" else str(tmp_path / "notify")
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as own:
        own.bind(address.replace("@", "\0", 1) if request.param == "abstract" else address)
        own.setblocking(False)
        yield address, own


def said(own: socket.socket) -> list[str]:
    found = []
    while True:
        try:
            found.append(own.recv(100).decode())
        except BlockingIOError:
            return found


def test_it_is_told(listening: tuple[str, socket.socket]) -> None:
    """Ready and stopping at once; alive twice as often as it wants to hear it, however many ticks there are."""
    address, own = listening
    now = 0.0
    manager = Manager(
        {"NOTIFY_SOCKET": address, "WATCHDOG_USEC": "60000000", "WATCHDOG_PID": str(os.getpid())}, lambda: now
    )
    manager.ready()
    assert said(own) == ["READY=1"]
    for second in range(120):
        now = float(second)
        manager.alive()
    assert said(own) == 4 * ["WATCHDOG=1"]
    manager.stopping()
    assert said(own) == ["STOPPING=1"]


@pytest.mark.parametrize(
    "watchdog",
    [{}, {"WATCHDOG_USEC": "x"}, {"WATCHDOG_USEC": "0"}, {"WATCHDOG_USEC": "1", "WATCHDOG_PID": "1"}],
)
def test_a_watchdog_that_is_not_ours(listening: tuple[str, socket.socket], watchdog: dict[str, str]) -> None:
    """None, nonsense, or another process': nothing is told."""
    address, own = listening
    Manager({"NOTIFY_SOCKET": address, **watchdog}).alive()
    assert said(own) == []


@pytest.mark.parametrize("address", ["", "/nowhere/notify", "@nobody-listens-here", "relative", "x" * 500])
def test_nobody_listens(address: str) -> None:
    """No manager, one that has gone, an address that is none: nothing happens."""
    manager = Manager({"NOTIFY_SOCKET": address, "WATCHDOG_USEC": "1"})
    for tell in (manager.ready, manager.alive, manager.stopping):
        tell()


def test_one_that_does_not_read_keeps_nobody(tmp_path: Path) -> None:
    """Its queue is full: what does not fit is lost."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as own:
        own.bind(str(tmp_path / "notify"))
        manager = Manager({"NOTIFY_SOCKET": str(tmp_path / "notify")})
        for _ in range(10_000):
            manager.ready()
