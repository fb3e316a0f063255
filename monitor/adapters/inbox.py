"""A bounded queue between the thread that hears and ours: the oldest dropped and counted.

A stalled callback blocks Zenoh's publishers for seconds and then cuts their link; so the callback only enqueues.
"""

from __future__ import annotations

import threading
from collections import deque
from typing import Generic, Protocol, TypeVar

MOST_BYTES = 256 * 2**20
"""Bytes that wait before the oldest entries are dropped."""
MOST_MESSAGES = 2_000_000


class Carrier(Protocol):
    """What waits: its size is that of its payload."""

    @property
    def payload(self) -> bytes:
        """What it carries."""
        ...


M = TypeVar("M", bound=Carrier)


class Inbox(Generic[M]):
    """Messages between another thread and ours: bounded in number and bytes.

    Parameters
    ----------
    most_bytes, most
        Bounds: of the payloads together [bytes], and of the messages.
    """

    def __init__(self, most_bytes: int = MOST_BYTES, most: int = MOST_MESSAGES) -> None:
        self._queue: deque[M] = deque()
        self._lock = threading.Lock()
        self._bytes = 0
        self._most_bytes, self._most = most_bytes, most
        self.received = 0
        """Messages that came in."""
        self.dropped = 0
        """Messages that were dropped because nobody took them."""

    def __len__(self) -> int:
        return len(self._queue)

    def put(self, message: M) -> None:
        """Append a message; drop the oldest ones that no longer fit. Called from any thread."""
        with self._lock:
            self.received += 1
            self._queue.append(message)
            self._bytes += len(message.payload)
            while self._bytes > self._most_bytes or len(self._queue) > self._most:
                self._bytes -= len(self._queue.popleft().payload)
                self.dropped += 1

    def take(self, most: int = MOST_MESSAGES, most_bytes: int = MOST_BYTES) -> list[M]:
        """Return the oldest messages, at most this many; no more after these bytes are reached."""
        taken: list[M] = []
        size = 0
        with self._lock:
            while self._queue and len(taken) < most and size < most_bytes:
                message = self._queue.popleft()
                size += len(message.payload)
                taken.append(message)
            self._bytes -= size
        return taken
