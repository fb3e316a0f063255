"""What is told of an assessed event beside its assessment: that it has closed, and its window for the eye."""

from __future__ import annotations

import numpy as np

from monitor.contract.evidence import Window
from monitor.contract.records import Assessment, Event
from monitor.detect.event import ClosedEvent
from monitor.identify.direct import model_response
from monitor.identify.fit import Fit


def closing(record: Assessment) -> Event:
    """Return the event of a load step that has proved to be one, or of a disturbance."""
    return Event(**{name: getattr(record, name) for name in Event.__struct_fields__})


def window_of(event: ClosedEvent, record: Assessment, fit: Fit | None) -> Window:
    """Return an event's samples, with what its model makes of them; NaN without one."""
    w = event.window
    return Window(
        id=record.id,
        loop=record.loop,
        onset=event.onset,
        time=event.onset + np.round(w.time * 1e9).astype(np.int64),
        sp=w.sp,
        pv=w.pv,
        op=w.op,
        model=np.full(len(w), np.nan) if fit is None else model_response(w, fit),
    )
