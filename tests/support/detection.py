"""What the tests of the detector share: a loop with a step, a detector run over it, its events sorted by kind."""

from __future__ import annotations

from dataclasses import fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from monitor.contract.loops import Loop
from monitor.contract.samples import Samples
from monitor.detect.detector import Detector, Found
from monitor.detect.event import LOAD_STEP, SETPOINT_RAMP, SETPOINT_STEP, ClosedEvent, EventWindow, Opened
from tests.support.plants import stepped


def events_of(found: Found) -> list[ClosedEvent]:
    """Set-point events that have closed."""
    return [e for e in found if isinstance(e, ClosedEvent) and e.kind == SETPOINT_STEP]


def ramps_of(found: Found) -> list[ClosedEvent]:
    """Set points that went on moving, handed out."""
    return [e for e in found if isinstance(e, ClosedEvent) and e.kind == SETPOINT_RAMP]


def loads_of(found: Found) -> list[ClosedEvent]:
    """Suspected load steps, handed out for verification."""
    return [e for e in found if isinstance(e, ClosedEvent) and e.kind == LOAD_STEP]


def openings_of(found: Found) -> list[Opened]:
    return [e for e in found if isinstance(e, Opened)]


def steps_of(found: Found) -> list[Opened | ClosedEvent]:
    """Set-point events, opened or closed."""
    return [*openings_of(found), *events_of(found)]


def columns_of(window: EventWindow) -> NDArray[np.float64]:
    """(n, 4) time, SP, PV, OP."""
    return np.column_stack([window.time, window.sp, window.pv, window.op])


def as_bytes(found: Found) -> list[tuple[str, bytes, bytes]]:
    """Everything an event says."""
    out = []
    for event in found:
        names = [f.name for f in fields(event) if f.name not in {"window", "health"}]
        said = repr([(name, getattr(event, name)) for name in names])
        if isinstance(event, Opened):
            out.append((said, b"", b""))
        else:
            window = event.window
            out.append((f"{said} {window.before}", columns_of(window).tobytes(), event.health.tobytes()))
    return out


def detected(samples: Samples, **facts: Any) -> tuple[Detector, Found]:
    detector = Detector([Loop(name="L", **facts)])
    found = detector.run(samples)
    return detector, found + detector.flush()


def closed_event() -> ClosedEvent:
    """A step of 4 that settled."""
    return events_of(detected(stepped(700))[1])[0]


def slots_are_whole(detector: Detector) -> None:
    """Each slot of the slab is either free, once, or held by one loop."""
    stores, slots = detector.stores, detector.state["window"]["slot"]
    free, held = stores.free[: stores.n_free[0]], slots[slots >= 0]
    together = np.sort(np.concatenate([free, held]))
    np.testing.assert_array_equal(together, np.arange(len(stores.slab)))
