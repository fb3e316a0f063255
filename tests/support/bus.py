"""A bus of plain lists in place of Zenoh's, and a query to it."""

from __future__ import annotations

import json
from collections import deque
from collections.abc import Callable
from typing import Any

from monitor.adapters.inbox import Inbox
from monitor.adapters.zenoh_bus import _parameters
from monitor.contract.entries import Message


class Question:
    """A query: a key expression matched the simple way (`*` a chunk, `**` any), verbatim chunks apart."""

    def __init__(self, key: str, parameters: str = "") -> None:
        self.key = key
        self.parameters = _parameters(parameters)
        self.payload = b""
        self.replies: list[tuple[str, bytes, str]] | None = None
        self.sent: list[tuple[str, bytes, str]] = []
        self.error: str | None = None

    def matches(self, key: str) -> bool:
        """Whether the query is for this key."""
        return _matches(self.key.split("/"), key.split("/"))

    def reply(self, key: str, payload: bytes, encoding: str) -> None:
        """Keep a reply."""
        assert self.matches(key)
        self.sent.append((key, payload, encoding))

    def end(self) -> None:
        """Keep the replies."""
        self.replies = self.sent

    def refuse(self, why: str) -> None:
        """Keep the reason."""
        self.error = why


def _matches(wanted: list[str], key: list[str]) -> bool:
    if not wanted or not key:
        return all(chunk == "**" for chunk in [*wanted, *key])
    if wanted[0] == "**":
        return _matches(wanted[1:], key) or (key[0][:1] != "@" and _matches(wanted, key[1:]))
    if key[0] == "**":
        return _matches(wanted, key[1:]) or (wanted[0][:1] != "@" and _matches(wanted[1:], key))
    same = wanted[0] == key[0] or ("*" in (wanted[0], key[0]) and "@" not in (wanted[0][:1], key[0][:1]))
    return same and _matches(wanted[1:], key[1:])


class FakeBus:
    """An inbox to fill, questions to ask, and all that was said, in order.

    ``on_publish`` is told of each record first, and may raise as a network does; ``keep`` false forgets what was said.
    """

    def __init__(self, *, keep: bool = True) -> None:
        self.inbox: Inbox[Message] = Inbox()
        self.questions: deque[Any] = deque()
        self.said: list[tuple[str, bytes, str]] = []
        self.on_publish: Callable[[str, bytes], None] | None = None
        self.publish_failed = self.twins = 0
        self.keep = keep

    def publish(self, key: str, payload: bytes, encoding: str) -> None:
        """Note what is published."""
        if self.on_publish is not None:
            self.on_publish(key, payload)
        if self.keep:
            self.said.append((key, payload, encoding))

    def put(self, key: str, payload: bytes, time: int) -> None:
        """Let a message come in that was sent at this time [ns]."""
        self.inbox.put(Message(key, payload, time))

    def kinds(self, last: str) -> list[dict[str, Any]]:
        """Records of loops that were said under this last chunk."""
        return [json.loads(p) for k, p, _ in self.said if k.rpartition("/")[2] == last and "/@/" not in k]
