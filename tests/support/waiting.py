"""Waiting for what another thread or process does, and a port that is free."""

from __future__ import annotations

import socket
import time
from collections.abc import Callable
from typing import Any, TypeVar

import pytest

PATIENCE = 300.0
"""How long a busy machine may take for anything; waiting ends with the event, not with the time [s]."""

Result = TypeVar("Result")


def until(condition: Callable[[], Result], seconds: float = PATIENCE) -> Result:
    """Wait until a condition holds and return what it says; fail after ``seconds``."""
    deadline = time.monotonic() + seconds
    while not (result := condition()):
        if time.monotonic() > deadline:
            pytest.fail(f"waited {seconds} s in vain")
        time.sleep(0.01)
    return result


def free_port() -> int:
    """Return a port of the loopback interface that nobody listens on [-]."""
    with socket.socket() as s:
        s.bind(("127.0.0.1", 0))
        return int(s.getsockname()[1])


def heard(session: Any, key: str) -> bool:
    """Whether somebody listens to this key of Zenoh's; he is known here a moment after he has begun."""
    publisher = session.declare_publisher(key)
    try:
        return bool(publisher.matching_status)
    finally:
        publisher.undeclare()
