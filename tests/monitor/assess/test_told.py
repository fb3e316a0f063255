"""What is told of an event beside its assessment has its id, its times and its samples."""

from __future__ import annotations

import numpy as np

from monitor.contract.loops import Loop
from tests.support.plants import stepped
from tests.support.runs import run


def test_each_assessment_has_its_window_and_its_closing() -> None:
    """The same id; the model where PV was, to what the fit leaves."""
    _, seen = run(Loop(name="L", kp=1.0, ti=40.0, process="integrating"), stepped(3000, kp=1.0, ti=40.0))
    (record,), (window,) = seen.assessments, seen.windows
    assert window.id == record.id == seen.closed[-1].id
    assert (seen.closed[-1].start, seen.closed[-1].end) == (record.start, record.end)
    assert window.onset == record.start
    assert len(window.time) == len(window.pv) == len(window.model)
    assert record.fit is not None
    after = window.time >= window.onset
    assert np.nanmax(np.abs(window.model - window.pv)[after]) < 0.2 * np.ptp(window.pv)
