"""The view as a process of its own: it may stall or die without the monitor noticing, and ends with us."""

from __future__ import annotations

import subprocess
import threading
from pathlib import Path

from monitor.adapters.process import end, start_own

LAST_WORD_S = 5.0
"""How long its end may take before the view ends itself by force [s]."""
END_WITHIN_S = LAST_WORD_S + 3.0
"""Before it is ended from outside [s]."""
SAID_WITHIN_S = 30.0
"""How long it may take to say where it can be seen [s]."""


class ViewProcess:
    """A running ``loopsight view``, whose output is read."""

    def __init__(self, process: subprocess.Popen[str]) -> None:
        self._process = process
        self._said = threading.Event()
        self._line = ""
        self._reader = threading.Thread(target=self._read, name="view-output", daemon=True)
        self._reader.start()

    @property
    def pid(self) -> int:
        """Id of the process."""
        return self._process.pid

    @property
    def url(self) -> str:
        """Where to look: an address for a browser, or empty where there is none. Waits until it is known."""
        self._said.wait(SAID_WITHIN_S)
        words = self._line.split()
        return words[1] if len(words) > 1 and words[1].startswith(("http:", "rerun+http:")) else ""

    def alive(self) -> bool:
        """Whether the view still runs."""
        return self._process.poll() is None

    def stop(self, within: float = END_WITHIN_S) -> None:
        """End the view and what it has started, by force after ``within`` [s]. Harmless twice."""
        end(self._process, within)
        self._reader.join(1.0)

    def _read(self) -> None:
        if self._process.stdout is not None:
            with self._process.stdout as out:
                for line in out:
                    if line.startswith("view ") and not self._said.is_set():
                        self._line = line.strip()
                        self._said.set()
        self._said.set()


def start_view(endpoint: str, view: str = "web", save: Path | None = None, zenoh: str = "") -> ViewProcess:
    """Start a view of the monitor at ``endpoint`` as a child process; returns at once.

    Parameters
    ----------
    endpoint
        Zenoh endpoint of the monitor, e.g. ``tcp/127.0.0.1:7447``.
    view
        ``web``, ``native`` or ``none`` (only with ``save``).
    save
        Record into this file.
    zenoh
        Zenoh's own configuration (.json5), with which the monitor is reached; empty: none.

    Raises
    ------
    OSError
        The process cannot be started.
    """
    record = ["--save", str(save)] if save else []
    secure = ["--zenoh", zenoh] if zenoh else []
    arguments = ["view", "--connect", endpoint, "--view", view, *record, *secure]
    return ViewProcess(start_own(*arguments, stdout=subprocess.PIPE))
