"""The queue between the thread that hears and ours: bounded, in order, and it counts."""

from __future__ import annotations

import threading

from hypothesis import given
from hypothesis import strategies as st

from monitor.adapters.inbox import Inbox
from monitor.contract.entries import Message
from tests.support.waiting import until


@given(
    st.lists(st.one_of(st.integers(0, 40), st.just("take")), max_size=60),
    st.integers(1, 8),
    st.integers(1, 100),
    st.integers(1, 5),
    st.integers(1, 80),
)
def test_the_inbox_against_a_list(steps, most, most_bytes, at_once, at_once_bytes):
    """Oldest dropped and counted, bytes and messages bounded, what is taken is the oldest in order."""
    inbox: Inbox[Message] = Inbox(most_bytes, most)
    twin: list[bytes] = []
    received = dropped = taken = 0
    for number, step in enumerate(steps):
        if step == "take":
            got = [m.payload for m in inbox.take(at_once, at_once_bytes)]
            expected: list[bytes] = []
            while twin and len(expected) < at_once and sum(map(len, expected)) < at_once_bytes:
                expected.append(twin.pop(0))
            assert got == expected
            taken += len(got)
        else:
            payload = bytes([number % 256]) * step
            inbox.put(Message("k", payload, 0))
            received += 1
            twin.append(payload)
            while len(twin) > most or sum(map(len, twin)) > most_bytes:
                twin.pop(0)
                dropped += 1
        assert (inbox.received, inbox.dropped, len(inbox)) == (received, dropped, len(twin))
        assert inbox._bytes == sum(map(len, twin))
    assert received == taken + dropped + len(twin)


def test_the_inbox_between_threads():
    """A producer and a consumer: nothing lost, nothing twice, in order."""
    inbox: Inbox[Message] = Inbox()
    n = 20_000
    producer = threading.Thread(target=lambda: [inbox.put(Message("k", b"x", k)) for k in range(n)])
    producer.start()
    got: list[int] = []
    until(lambda: got.extend(m.time for m in inbox.take(100)) or len(got) == n)
    producer.join()
    assert got == list(range(n))
    assert inbox.dropped == 0


def test_without_bounds_all_is_taken():
    """Too many: the oldest are gone, and it says how many; then it is empty."""
    inbox: Inbox[Message] = Inbox(most=3)
    for k in range(10):
        inbox.put(Message(str(k), b"", 0))
    assert [m.key for m in inbox.take()] == ["7", "8", "9"]
    assert (inbox.received, inbox.dropped, inbox.take()) == (10, 7, [])
