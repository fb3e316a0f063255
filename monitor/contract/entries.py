"""What has arrived: messages of the bus, and their entries."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

MOST_PAYLOAD_BYTES = 16 * 2**20
"""Bytes of a payload above which it is refused unread."""

SAMPLE, TAG_SP, TAG_OP, TAG_AUTO, TAG_PV = range(5)
"""Kinds of entry; of equal times a tag's set point, output and mode come before its PV."""
MODE_UNKNOWN = -1
"""A mode that could not be read, or was not said: the loop's last known one holds."""

ENTRY = np.dtype(
    [
        ("time", np.int64),
        ("loop", np.int32),
        ("kind", np.int8),
        ("auto", np.int8),
        ("quality", np.uint8),
        ("sp", np.float64),
        ("pv", np.float64),
        ("op", np.float64),
    ],
    align=True,
)
"""One arrival: a whole sample, or one quantity of it. Aligned: 48 bytes, whose columns are read three times as fast."""


Entries = NDArray[np.void]
"""(N,) of dtype `ENTRY`."""


@dataclass(frozen=True, slots=True)
class Message:
    """What came in under one key."""

    key: str
    payload: bytes
    time: int
    """The bus's timestamp, else the arrival: for samples that bring no time [ns since 1970]."""
