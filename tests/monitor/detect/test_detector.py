"""The detector: loops apart from each other, loops that join later, the period."""

from __future__ import annotations

from dataclasses import replace
from typing import get_type_hints

import numpy as np
import pytest

from monitor.contract.loops import Loop
from monitor.contract.samples import Samples
from monitor.detect.detector import Detector
from monitor.identify.direct import fit_window
from sim_plants.loops import Simulation
from sim_plants.scenarios import reference_loops
from sim_plants.specs import NEVER, Steps
from tests.monitor.detect.tools import REFERENCE
from tests.support.detection import as_bytes, detected, events_of, openings_of
from tests.support.plants import SECOND, START, samples_of, stepped, times


@pytest.mark.parametrize("name", REFERENCE)
def test_fit_gives_the_half_rules_dead_time_of_the_reference_loops(name):
    """The fit's effective dead time lies within 15 % of the half rule's, gain within 1 %, T0 within 10 %."""
    gain, t0, dead_time, *_ = REFERENCE[name]
    (spec,) = (s for s in reference_loops(0, 0.05) if s.name == name)
    spec = replace(spec, setpoint=Steps((20.0,), (1.0,)), load=NEVER)
    _, found = detected(samples_of(Simulation([spec]).advance(520.0)))
    (event,) = events_of(found)
    fit = fit_window(event.window, "integrating")
    assert fit is not None
    assert fit.dead_time == pytest.approx(dead_time, rel=0.15)
    assert fit.gain == pytest.approx(gain, rel=0.01)
    assert fit.t0 == pytest.approx(t0, rel=0.1)  # the long tail has cost the window its resolution


def test_loops_do_not_see_each_other(fleet):
    """Each loop alone, and all loops in another order of rows, give that loop's events bit by bit."""
    loops, samples = fleet
    whole = Detector(loops).run(samples)
    order = np.random.default_rng(4).permutation(len(loops))
    place = np.argsort(order).astype(np.int32)
    other = Detector([loops[k] for k in order]).run(replace(samples, loop=place[samples.loop]))
    for k, loop in enumerate(loops):
        rows = samples.take(samples.loop == k)
        alone = Detector([loop]).run(replace(rows, loop=np.zeros(len(rows), np.int32)))
        for found, row in ((whole, k), (other, place[k])):
            mine = [replace(event, row=0) for event in found if event.row == row]
            assert as_bytes(mine) == as_bytes(alone)


def test_loops_added_later_leave_the_others_alone():
    """A new row in mid-event: the old loop's event comes out as if nothing had been added."""
    samples = stepped(700, noise=0.01)
    alone = as_bytes(detected(samples)[1])
    detector = Detector([Loop(name="L")])
    found = detector.run(samples.take(slice(0, 230)))
    detector.add([Loop(name="M"), Loop(name="N")])
    found += detector.run(samples.take(slice(230, None)))
    assert as_bytes(found) == alone
    other = detector.run(replace(samples, loop=np.full(700, 2, np.int32)))
    assert len(events_of(other)) == 1


def test_the_period_is_measured_and_followed():
    """Without a nominal period it is the median step; a gateway that changes its rate is followed."""
    detector = Detector([Loop(name="L")])
    detector.run(Samples.of(0, times(200, 2.0), 50.0, 50.0, 20.0))
    assert detector.state[0]["clock"]["period"] == 2.0
    detector.run(Samples.of(0, times(300, 5.0, START + 1000 * SECOND), 50.0, 50.0, 20.0))
    assert detector.state[0]["clock"]["period"] == 5.0


def test_a_closed_event_is_of_plain_numbers_and_words():
    """What the kernel hands out has the types that its records promise, and columns of one length."""
    (opened,), (closed,) = openings_of(found := detected(stepped(700))[1]), events_of(found)
    for event in (opened, closed):
        for name, kind in get_type_hints(type(event)).items():
            assert type(getattr(event, name)) is kind, name
    window = closed.window
    for column in (window.time, window.sp, window.pv, window.op):
        assert (column.shape, column.dtype) == ((len(window),), np.float64)
        assert column.flags.c_contiguous
