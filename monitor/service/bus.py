"""What the service needs of a bus: it is told, asked, and publishes. Plain enough that a test brings its own."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol

from monitor.adapters.inbox import Inbox
from monitor.contract.entries import Message

Reply = tuple[str, bytes, str]
"""Key, payload, encoding."""


class Question(Protocol):
    """A query that waits for its answer."""

    @property
    def key(self) -> str:
        """The key expression that is asked for."""

    @property
    def parameters(self) -> Mapping[str, str]:
        """What stands behind its question mark."""

    @property
    def payload(self) -> bytes:
        """What comes with it; empty where nothing does, or too much."""

    def matches(self, key: str) -> bool:
        """Whether this key is asked for."""

    def reply(self, key: str, payload: bytes, encoding: str) -> None:
        """Send one of its replies."""

    def end(self) -> None:
        """Say that there are no more."""

    def refuse(self, why: str) -> None:
        """Reply with an error, one line, and end the query."""


class Questions(Protocol):
    """Queries that wait, e.g. a deque of them."""

    def __len__(self) -> int: ...

    def popleft(self) -> Question:
        """Take the one that has waited longest."""


class Bus(Protocol):
    """Brings messages and questions from its own threads; publishes from ours."""

    @property
    def inbox(self) -> Inbox[Message]:
        """What has come in."""

    @property
    def questions(self) -> Questions:
        """What was asked."""

    @property
    def publish_failed(self) -> int:
        """Records that it would not take."""

    @property
    def twins(self) -> int:
        """Other monitors that call themselves as we do."""

    def publish(self, key: str, payload: bytes, encoding: str) -> None:
        """Publish a record."""
