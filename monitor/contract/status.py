"""The monitor's health: counters, rates and delays, as one record, the same on the bus and for its readers."""

from __future__ import annotations

import msgspec

NOT_READY = {
    "store": "the store fails",
    "no_data": "nothing has come in yet",
    "silent": "no loop sends",
}
"""Why a monitor is not ready, in words."""


class LoopCounts(msgspec.Struct, frozen=True, kw_only=True):
    """Loops by verdict and by what they do."""

    total: int
    retune: int
    inconclusive: int
    good: int
    not_assessed: int
    open: int
    """With an open event."""
    stale: int
    never_heard: int = 0
    """Of which nothing has come since the monitor began."""


class Rates(msgspec.Struct, frozen=True):
    """What comes in [1/s]."""

    messages: float
    samples: float


class Status(msgspec.Struct, frozen=True, kw_only=True):
    """A monitor's health. Names and order are those of the JSON on the wire.

    What is added has a default: a monitor of an earlier version is understood, too.
    """

    id: str
    time: str
    uptime: float
    """[s]"""
    ready: bool
    """Whether what comes in is heard, and what is found is kept."""
    not_ready: list[str]
    """Why not: keys of `NOT_READY`."""
    loops: LoopCounts
    flagged: list[str]
    messages: int
    dropped: int
    """Messages for which there was no room."""
    samples_ok: int
    uncertain: int
    bad_value: int
    bad_quality: int
    duplicate: int
    conflict: int
    late: int
    malformed: int
    too_large: int
    unknown_loop: int
    future: int
    bad_time: int
    missed_frames: int
    repeated_frames: int
    clock_steps: int
    """Clocks of loops that were set back."""
    clock_ahead: list[str]
    stale: list[str]
    never_heard: list[str] = []
    shelved: dict[str, str] = {}
    """Loops whose flags are put aside: until when, and why."""
    disturbances: int
    unknown: dict[str, int]
    """Keys or names that no loop has, with how often they came."""
    rates: Rates
    queue: int
    """Messages that wait."""
    latency: float
    """Longest wait of a message since the last status was published [s]."""
    held: int
    """Samples that are held for their order."""
    reorder_overflow: int
    """Samples let go before the window's end, for want of room."""
    backlog: int
    """Events that wait to be assessed."""
    waiting_for_store: int
    records_lost: int
    """Because the store failed for too long."""
    publish_failed: int
    """Records that the bus would not take."""
    twins: int = 0
    """Other monitors under the same id."""
