"""What the tests of the detector share: a loop with a step, a detector run over it, its events sorted by kind."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from monitor.contract.loops import Loop
from monitor.contract.samples import Samples
from monitor.detect.detector import Detector
from monitor.detect.state import CLOSED, COUNTS, OPENED
from tests.support.plants import pi_loop, times

Found = list[tuple[Any, NDArray[np.float64]]]


def is_step(event: Any) -> bool:
    """Whether it is a set-point step's; the kernel also hands out what may be a load step, to be verified."""
    return "kind" not in event.dtype.names or event["kind"] == 0


def events_of(found: Found, what: int = CLOSED) -> list[Any]:
    return [event for event, _ in found if event["what"] == what and is_step(event)]


def loads_of(found: Found) -> list[Any]:
    """Suspected load steps, handed out for verification."""
    return [event for event, _ in found if event["what"] == CLOSED and not is_step(event)]


def steps_of(found: Found) -> list[Any]:
    """Set-point events, opened or closed."""
    return events_of(found, OPENED) + events_of(found)


def closings(found: Found) -> Found:
    """Set-point events with their windows."""
    return [(event, window) for event, window in found if event["what"] == CLOSED and is_step(event)]


def as_bytes(found: Found) -> list[tuple[bytes, bytes]]:
    """Everything an event says but the slot its window happened to lie in."""
    out = []
    for event, window in found:
        copy = event.copy()
        copy["slot"] = copy["loop_state"]["slot"] = 0
        for name in (*COUNTS, "lates", "late_at", "ok_before", "uncertain_before"):
            copy["loop_state"][name] = 0
        out.append((copy.tobytes(), window.tobytes()))
    return out


def stepped(n: int = 700, at: int = 200, size: float = 4.0, **facts: Any) -> Samples:
    """One loop with a set-point step, at rest before it."""
    sp = np.full(n, 50.0)
    sp[at:] += size
    pv, op = pi_loop(sp, **facts)
    return Samples.of(0, times(n), sp, pv, op)


def detected(samples: Samples, **facts: Any) -> tuple[Detector, Found]:
    detector = Detector([Loop(name="L", **facts)])
    found = detector.run(samples)
    return detector, found + detector.flush()


def slots_are_whole(detector: Detector) -> None:
    """Each slot of the slab is either free, once, or held by one loop."""
    free = detector.free[: detector.n_free[0]]
    held = detector.state["slot"][detector.state["slot"] >= 0]
    together = np.sort(np.concatenate([free, held]))
    np.testing.assert_array_equal(together, np.arange(len(detector.slab)))
