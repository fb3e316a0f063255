"""Rerun's own programs as children: the web server, the native viewer. Loopback only, no telemetry.

The wheel's ``rerun`` command is a wrapper that leaves its child behind when it is stopped, so the program is
started directly. It never outlives this process, however that ends (Linux; elsewhere when it ends in order).
"""

from __future__ import annotations

import importlib.util
import json
import os
import socket
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from urllib.parse import quote

from monitor.adapters.process import LINUX, end, start_foreign

from .page import Page

SERVER_MEMORY = "128MB"
"""What the server keeps for a browser that is opened late; the oldest samples go first."""

VIEWER_MEMORY = "1GB"


class RerunError(RuntimeError):
    """Rerun's program is missing or does not start."""


def program() -> Path:
    """Path of Rerun's program.

    Raises
    ------
    RerunError
        The wheel that brings it is not installed.
    """
    spec = importlib.util.find_spec("rerun_cli")
    for folder in (spec.submodule_search_locations or []) if spec else []:
        path = Path(folder) / ("rerun.exe" if sys.platform == "win32" else "rerun")
        if path.is_file():
            return path
    raise RerunError("the Rerun viewer is not installed (rerun-sdk)")


def has_display() -> bool:
    """Whether a window could be opened here."""
    return not LINUX or bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


class RerunProcess:
    """A running program of Rerun's. ``proxy`` is where to log to, ``url`` what to open."""

    def __init__(self, arguments: Sequence[str], ports: Sequence[int], deadline: float) -> None:
        self._folder = tempfile.TemporaryDirectory(prefix="loopsight-view-")
        self._errors = Path(self._folder.name) / "errors"
        self.proxy = f"rerun+http://127.0.0.1:{ports[0]}/proxy"
        self.url = self.proxy
        self.page: Page | None = None
        line = [str(program()), "--bind", "127.0.0.1", "--port", str(ports[0]), *arguments]
        with self._errors.open("wb") as errors:
            self.process = start_foreign(line, environment=self._environment(), errors=errors)
        try:
            self._await(ports, deadline)
        except RerunError:
            self.stop()
            raise

    def alive(self) -> bool:
        """Whether it still runs."""
        return self.process.poll() is None

    def stop(self, patience: float = 1.5) -> None:
        """End it, by force after ``patience`` [s]. Harmless when it has ended already."""
        if self.page is not None:
            self.page.stop()
            self.page = None
        end(self.process, patience)
        self._folder.cleanup()

    def _environment(self) -> dict[str, str]:
        """Telemetry off for this child alone; the user's own choice for Rerun stays as it is."""
        folder = Path(self._folder.name) / "rerun"
        folder.mkdir()
        file = folder / "analytics.json"
        off = {"analytics_enabled": False, "analytics_id": "none", "metadata": {}}
        places = {
            "config_file_path": str(file),
            "data_dir_path": str(folder),
        }  # a field less, and it is refused
        file.write_text(json.dumps(off | places))
        return {**os.environ, "XDG_CONFIG_HOME": self._folder.name, "RUST_LOG": "error"}

    def _await(self, ports: Sequence[int], deadline: float) -> None:
        """Return when all ports answer."""
        for port in ports:
            while not _answers(port):
                if not self.alive():
                    raise RerunError(f"the Rerun viewer does not start: {self._last_error()}")
                if time.monotonic() > deadline:
                    raise RerunError("the Rerun viewer does not answer")
                time.sleep(0.02)

    def _last_error(self) -> str:
        lines = self._errors.read_text(encoding="utf-8", errors="replace").strip().splitlines()
        return lines[-1][:300] if lines else f"exit {self.process.returncode}"


def serve_web(recording: Path | None = None, patience: float = 20.0) -> RerunProcess:
    """Start the web viewer and its server on free ports of the loopback interface.

    Parameters
    ----------
    recording
        Show this file; without it the server waits for data at ``proxy``.
    patience
        How long it may take to start [s].

    Raises
    ------
    RerunError
        The program is missing or does not start.
    """
    given = [str(recording.resolve())] if recording else []
    for attempt in (1, 2, 3):
        ports = free_ports(2)
        options = ["--serve-web", "--web-viewer-port", str(ports[1]), "--server-memory-limit", SERVER_MEMORY]
        try:
            server = RerunProcess([*options, *given], ports, time.monotonic() + patience)
        except RerunError:
            if attempt == 3:  # another process may have taken a port in between, hardly three times
                raise
            continue
        server.page = page = Page(ports[1], ports[0])
        server.url = f"http://127.0.0.1:{page.port}/?url={quote(server.proxy, safe='')}&hide_welcome_screen"
        return server
    raise AssertionError


def open_native(recording: Path | None = None, patience: float = 20.0) -> RerunProcess:
    """Open the native viewer's window. Parameters and errors as for ``serve_web``."""
    given = [str(recording.resolve())] if recording else ["--expect-data-soon"]
    options = ["--hide-welcome-screen", "--memory-limit", VIEWER_MEMORY, *given]
    return RerunProcess(options, free_ports(1), time.monotonic() + patience)


def free_ports(count: int) -> list[int]:
    """Ports of the loopback interface that were free a moment ago."""
    sockets = [socket.socket() for _ in range(count)]
    try:
        for s in sockets:
            s.bind(("127.0.0.1", 0))
        return [int(s.getsockname()[1]) for s in sockets]
    finally:
        for s in sockets:
            s.close()


def _answers(port: int) -> bool:
    with socket.socket() as s:
        s.settimeout(0.5)
        return s.connect_ex(("127.0.0.1", port)) == 0
