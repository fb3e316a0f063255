"""What is asked and answered: stored assessments and their evidence, loops as they stand, the monitor's health."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator

from monitor.adapters.store import Store, StoreError
from monitor.contract import keys
from monitor.contract.records import LoopRow
from monitor.contract.times import given_time
from monitor.engine import Engine
from monitor.wire.encode import FRAME_MIME, JSON_MIME, encode_record

from .bus import Question, Questions, Reply

ANSWER_RECORDS = 10_000
"""That answer one query, at most."""
SLICE_RECORDS = 100
"""Of one query, before the next one has its turn: who asks for one thing does not wait for who asks for all."""
UNDER_WAY = 100
"""Queries that are answered in turn; others wait for theirs."""
DEFAULT_RECORDS = 1000
"""Of each loop, where a query names no limit."""


class Queries:
    """Answers questions.

    Parameters
    ----------
    monitor
        Name of this monitor in its own keys.
    engine, store
        What is known, of this run and of earlier ones.
    row
        A loop's current row.
    status
        The monitor's health, encoded.
    obey
        Does what a command asks for, and answers; None: commands are off.

    Raises
    ------
    StoreError
        The rows of earlier runs cannot be read.
    """

    def __init__(
        self,
        monitor: str,
        engine: Engine,
        store: Store,
        row: Callable[[int], LoopRow],
        status: Callable[[], bytes],
        obey: Callable[[bytes], bytes] | None = None,
    ) -> None:
        self._own, self._command = keys.monitor_status(monitor), keys.monitor_command(monitor)
        self._obey = obey
        self._engine, self._loops, self._store = engine, engine.loops, store
        self._row, self._status = row, status
        self._under_way: deque[tuple[Question, Iterator[Reply]]] = deque()
        self._old_rows = store.rows()
        """Loops' last rows of earlier runs, by key: they hold until a loop is assessed anew."""

    def answer(self, questions: Questions, in_time: Callable[[], bool]) -> None:
        """Go on with what was asked, a slice of each in turn, at least one and then as many as there is time for."""
        while self._under_way or questions:
            while questions and len(self._under_way) < UNDER_WAY:
                question = questions.popleft()
                self._under_way.append((question, self._replies(question)))
            question, replies = self._under_way.popleft()
            try:
                if self._slice(question, replies, in_time):
                    self._under_way.append((question, replies))
            except (ValueError, StoreError) as error:
                question.refuse(str(error))
            if not in_time():
                return

    def _slice(self, question: Question, replies: Iterator[Reply], in_time: Callable[[], bool]) -> bool:
        """Send some replies; False when they are at their end."""
        for _ in range(SLICE_RECORDS):
            reply = next(replies, None)
            if reply is None:
                question.end()
                return False
            question.reply(*reply)
            if not in_time():
                break
        return True

    def forget(self, key: str) -> None:
        """Forget the earlier runs' row of a loop: other settings hold now, or the loop is watched no more."""
        self._old_rows.pop(key, None)

    def _replies(self, question: Question) -> Iterator[Reply]:
        """Make the replies one after the other: loops may come and go in between."""
        chunks = question.key.split("/")
        if question.key == self._command:
            if self._obey is None:
                raise ValueError("commands are off, expected commands = true in the configuration")
            yield self._command, self._obey(question.payload), JSON_MIME
            return
        if chunks[-1] == "status":
            yield from self._standing(question)
            return
        if len(chunks) > 1 and chunks[-2] == "window":
            found = self._store.window(chunks[-1])
            key = "" if found is None else keys.window(found[0], chunks[-1])
            if found is not None and question.matches(key):
                yield key, found[1], FRAME_MIME
            return
        yield from self._history(question)

    def _standing(self, question: Question) -> Iterator[Reply]:
        """Return the monitor's health, or the rows of the loops asked for."""
        if question.matches(self._own):
            yield self._own, self._status(), JSON_MIME
            return
        for key in list(self._loops.by_key):
            if question.matches(keys.status(key)) and (number := self._loops.by_key.get(key)) is not None:
                yield keys.status(key), self._current(key, number), JSON_MIME

    def _current(self, key: str, number: int) -> bytes:
        """Return a loop's row: of this run, or the last one kept of an earlier run."""
        if self._engine.verdict(number) is None and key in self._old_rows:
            return self._old_rows[key]
        return encode_record(self._row(number))

    def _history(self, question: Question) -> Iterator[Reply]:
        """Return stored assessments of the loops asked for, one key each."""
        asked = question.parameters
        since, until = (_instant(name, asked.get(name)) for name in ("since", "until"))
        limit = _limit(asked.get("limit"))
        last = question.key.rpartition("/")[2]
        if (
            "*" not in last and not asked
        ):  # one event: however many its loop has had since, and whether it is watched still
            found = self._store.assessment(last)
            key = "" if found is None else keys.history(found[0], last)
            if found is not None and question.matches(key):
                yield key, found[1], JSON_MIME
            return
        sent = 0
        for loop_key in list(self._loops.by_key):
            if not question.matches(keys.history(loop_key, last)):
                continue
            for identity, payload in self._store.assessments(loop_key, since, until, limit):
                key = keys.history(loop_key, identity)
                if question.matches(key):
                    yield key, payload, JSON_MIME
                    sent += 1
                    if sent >= ANSWER_RECORDS:
                        return


def _instant(name: str, text: str | None) -> int | None:
    """Read a time of a query [ns]: ISO or epoch seconds."""
    if text is None:
        return None
    try:
        return given_time(text.replace(" ", "+"))  # what a browser makes of a + in a zone
    except ValueError:
        raise ValueError(f"{name}: {text[:50]!r}, expected ISO time or epoch seconds") from None


def _limit(text: str | None) -> int:
    """Read how many assessments of each loop are asked for."""
    if text is None:
        return DEFAULT_RECORDS
    if not (text.isascii() and text.isdigit() and 0 < len(text) <= 9):
        raise ValueError(f"limit: {text[:50]!r}, expected a whole number of 0 or more")
    return min(int(text), ANSWER_RECORDS)
