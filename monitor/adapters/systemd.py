"""The service manager that started us, if one did: told when we are ready, alive, and about to stop (sd_notify)."""

from __future__ import annotations

import os
import socket
import time
from collections.abc import Callable, Mapping
from contextlib import suppress


class Manager:
    """Tells the service manager; does nothing where there is none.

    Parameters
    ----------
    environment
        In which it says where it listens, and how often it wants to hear that we are alive.
    monotonic
        [s]
    """

    def __init__(
        self, environment: Mapping[str, str] = os.environ, monotonic: Callable[[], float] = time.monotonic
    ) -> None:
        self._address = environment.get("NOTIFY_SOCKET", "")
        if self._address.startswith("@"):  # in the abstract namespace
            self._address = "\0" + self._address[1:]
        watched = environment.get("WATCHDOG_PID", "") in {"", str(os.getpid())}
        micros = environment.get("WATCHDOG_USEC", "")
        self._every = (
            int(micros) * 0.5e-6 if watched and micros.isdecimal() else 0.0
        )  # twice as often as it must
        self._next = float("-inf")
        self._monotonic = monotonic

    def ready(self) -> None:
        """Tell that the work has begun."""
        self._say("READY=1")

    def alive(self) -> None:
        """Tell that the work goes on, as often as it wants to hear it: without it for long, it starts us anew."""
        now = self._monotonic()
        if self._every and now >= self._next:
            self._next = now + self._every
            self._say("WATCHDOG=1")

    def stopping(self) -> None:
        """Tell that the end has begun."""
        self._say("STOPPING=1")

    def _say(self, state: str) -> None:
        if not self._address:
            return
        with suppress(OSError), socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_CLOEXEC) as to:
            to.setblocking(False)  # whoever does not listen must not keep us
            to.sendto(state.encode(), self._address)
