"""Programs in processes of their own that end with us, and being told to stop ourselves: one way for each.

A child of ours is told our process id and ends by itself when we have gone; a program of somebody else's is
ended by the kernel (Linux; elsewhere when we end in order).
"""

from __future__ import annotations

import ctypes
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from types import FrameType
from typing import IO, Any, Self

LINUX = sys.platform.startswith("linux")
STOP_WITHIN_S = 9.0
"""Between being told to stop and a hard end: nothing may keep a service manager waiting [s]."""
END_WITHIN_S = 5.0
"""For a child to end by itself once it was told to [s]."""

_LIBC = ctypes.CDLL(None) if LINUX else None
_PR_SET_PDEATHSIG = 1


# ---------------------------------------------------------------------------------------------------
# children


def start_own(*arguments: str, stdout: int | None = None) -> subprocess.Popen[str]:
    """Start a command of ours, e.g. ``start_own("simulate", "--speed", "60")``; it ends with this process.

    The command has the option ``--parent`` and hands it to `Stop`. Ctrl-C is for us, who stop it in our order.

    Parameters
    ----------
    stdout
        As of `subprocess.Popen`; None: ours.

    Raises
    ------
    OSError
        The process cannot be started.
    """
    line = [sys.executable, "-m", "monitor", *arguments, "--parent", str(os.getpid())]
    return _start(line, stdout=stdout, text=True, start_new_session=True)


def start_foreign(
    line: Sequence[str], *, environment: Mapping[str, str], errors: IO[bytes]
) -> subprocess.Popen[bytes]:
    """Start somebody else's program, in silence; the kernel ends it with the thread that started it.

    Start it before other threads: it is forked.

    Raises
    ------
    OSError
        The process cannot be started.
    """
    return _start(
        line,
        stdout=subprocess.DEVNULL,
        stderr=errors,
        env=environment,
        preexec_fn=_follow_parent if LINUX else None,
    )


def end(child: subprocess.Popen[Any], within: float = END_WITHIN_S) -> None:
    """End a child, by force after ``within`` [s]. Harmless when it has ended already."""
    if child.poll() is None:
        child.terminate()
        try:
            child.wait(within)
        except subprocess.TimeoutExpired:
            child.kill()
    child.wait()


def _start(line: Sequence[str], **how: Any) -> subprocess.Popen[Any]:
    return subprocess.Popen(line, stdin=subprocess.DEVNULL, **how)  # noqa: S603 (our own, or the caller's program)


def _follow_parent() -> None:
    """Between fork and exec: the kernel ends this child with the thread that started it."""
    if _LIBC is not None:
        _LIBC.prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)  # a milder one would wait in a program that is stopped


# ---------------------------------------------------------------------------------------------------
# being told


class Told(BaseException):
    """What runs is broken off: the process was told to stop."""


class Stop(threading.Event):
    """Set by SIGTERM and SIGINT, and when the parent has gone. In force inside ``with``, in the main thread.

    Once it is set the process has to end, and stays told: what still hangs then is ended by force.

    Parameters
    ----------
    within
        Between being told and the hard end [s].
    code
        Exit code of the hard end.
    parent
        Id of the process to end with; looked at whenever this is asked or waited for.
    """

    def __init__(self, within: float = STOP_WITHIN_S, code: int = 1, parent: int | None = None) -> None:
        super().__init__()
        self._within, self._code, self._parent = within, code, parent
        self._told = self._breaks = False
        self._before: dict[int, Any] = {}

    def __enter__(self) -> Self:
        for number in (signal.SIGTERM, signal.SIGINT):
            self._before[number] = signal.signal(number, self._tell)
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        if kind is not None:
            self._code = 1
        if self._told:  # told twice is told once
            return
        for number, handler in self._before.items():
            signal.signal(number, handler)

    def set(self) -> None:
        """End soon; by force if it takes too long."""
        if not self._told:
            self._told = True
            threading.Thread(target=self._end, name="stop", daemon=True).start()

    def is_set(self) -> bool:
        """Whether it is time to end."""
        self._look()
        return self._told

    def wait(self, timeout: float | None = None) -> bool:
        """Wait at most so long [s]; True when it is time to end."""
        self._look()
        return self._told or super().wait(timeout)

    @contextmanager
    def breaking_off(self, within: float = END_WITHIN_S) -> Iterator[None]:
        """Break off what runs inside when told to stop, instead of waiting for its end: nothing is lost with it.

        Where it swallows that (a compiler does) the process ends ``within`` [s], with exit code 0.
        """
        usual = self._within, self._code
        self._within, self._code, self._breaks = within, 0, True
        try:
            yield
        except Told:
            pass
        finally:
            self._breaks = False
            if not self._told:
                self._within, self._code = usual

    def _tell(self, *_: int | FrameType | None) -> None:
        first = not self._told
        self.set()
        if first and self._breaks:
            raise Told

    def _end(self) -> None:
        super().set()  # in a thread of its own: a signal may come while ours, in `wait`, has the event's lock
        time.sleep(self._within)
        os._exit(self._code)

    def _look(self) -> None:
        if self._parent is not None and os.getppid() != self._parent:
            self.set()


class Hangup:
    """Whether SIGHUP has come: read your configuration again. In force inside ``with``, in the main thread."""

    def __init__(self) -> None:
        self._come = False
        self._before: Any = None

    def __enter__(self) -> Self:
        if hasattr(signal, "SIGHUP"):  # not on Windows
            self._before = signal.signal(signal.SIGHUP, self._note)
        return self

    def __exit__(self, *_: object) -> None:
        if hasattr(signal, "SIGHUP"):
            signal.signal(signal.SIGHUP, self._before)

    def _note(self, *_: int | FrameType | None) -> None:
        self._come = True

    def take(self) -> bool:
        """Whether it has come since this was last asked."""
        come, self._come = self._come, False
        return come
