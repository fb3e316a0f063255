"""Flags that somebody has put aside for a time: the valve is ordered, the tuner comes on Thursday. Kept."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from typing import Any

import msgspec

from monitor.adapters.store import Shelved, Store, StoreError
from monitor.contract.loops import MOST_NAME_BYTES, LoopTable
from monitor.contract.times import given_time, iso
from monitor.wire.encode import to_json

from .journal import note

MOST_REASON = 200
"""Characters of a reason."""


class Command(msgspec.Struct, forbid_unknown_fields=True):
    """What may be asked for, as JSON."""

    command: str
    """``shelve`` or ``unshelve``."""
    loop: str
    reason: str = ""
    until: str = ""
    """ISO time."""


class Shelf:
    """Which loops' flags are put aside.

    Parameters
    ----------
    clock
        [ns since 1970]

    Raises
    ------
    StoreError
        What is kept cannot be read.
    """

    def __init__(self, loops: LoopTable, store: Store, clock: Callable[[], int]) -> None:
        self._loops, self._store, self._clock = loops, store, clock
        self._own = {one.key: one for one in store.shelved()}

    @property
    def rows(self) -> set[int]:
        """Rows of the loops whose flags are put aside."""
        return {row for key in self._own if (row := self._loops.by_key.get(key)) is not None}

    @property
    def said(self) -> dict[str, str]:
        """By loop: until when, and why."""
        return {
            self._loops[row].name: f"until {iso(one.until)}: {one.reason}"
            for key, one in self._own.items()
            if (row := self._loops.by_key.get(key)) is not None
        }

    def obey(self, payload: bytes) -> bytes:
        """Do what a `Command` asks for; return how things stand then, as JSON.

        Raises
        ------
        ValueError
            It is none: one line with what would be accepted.
        StoreError
            It cannot be kept.
        """
        try:
            asked = msgspec.json.decode(payload, type=Command)
        except (msgspec.MsgspecError, RecursionError) as error:
            raise ValueError(f"command: {error}") from None
        row = self._loops.by_name.get(asked.loop)
        if row is None:
            raise ValueError(f"loop: {asked.loop[:MOST_NAME_BYTES]!r}, expected one that is watched")
        if asked.command == "shelve":
            self._put(
                row, Shelved(self._loops[row].key, _end(asked.until, self._clock()), _reason(asked.reason))
            )
        elif asked.command == "unshelve":
            self._take(row)
        else:
            raise ValueError(f"command: {asked.command[:50]!r}, expected shelve or unshelve")
        own = self._own.get(self._loops[row].key)
        answer: dict[str, Any] = {"loop": asked.loop, "until": None, "reason": ""}
        if own is not None:
            answer |= {"until": iso(own.until), "reason": own.reason}
        return to_json(answer)

    def look(self) -> None:
        """Put back the flags whose time has come; while the store fails, later."""
        now = self._clock()
        for key in [key for key, one in self._own.items() if one.until <= now]:
            row = self._loops.by_key.get(key)
            if row is not None:
                with suppress(StoreError):  # the outbox says it
                    self._take(row)

    def _put(self, row: int, one: Shelved) -> None:
        with self._store.transaction():
            self._store.keep_shelved(one)
        self._own[one.key] = one
        note("shelved", loop=self._loops[row].name, until=iso(one.until), why=one.reason)

    def _take(self, row: int) -> None:
        key = self._loops[row].key
        if key in self._own:
            with self._store.transaction():
                self._store.drop_shelved(key)
            del self._own[key]
            note("unshelved", loop=self._loops[row].name)


def _end(text: str, now: int) -> int:
    """Read until when [ns since 1970]."""
    try:
        until = given_time(text)
    except ValueError:
        raise ValueError(f"until: {text[:50]!r}, expected ISO time, e.g. 2026-12-24T12:00:00Z") from None
    if until <= now:
        raise ValueError(f"until: {text[:50]!r}, expected a time to come")
    return until


def _reason(text: str) -> str:
    """Read why."""
    if not text.strip() or len(text) > MOST_REASON:
        raise ValueError(f"reason: {len(text)} characters, expected some, at most {MOST_REASON}")
    return text.strip()
