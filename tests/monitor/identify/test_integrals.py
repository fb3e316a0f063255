"""Gain, T0 and the size of a load by running integrals: the reference loops of the literature."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from monitor.contract.loops import Loop
from monitor.detect.detector import Detector
from monitor.detect.event import ClosedEvent
from monitor.identify.integrals import setpoint_integrals
from sim_plants.loops import Simulation
from sim_plants.scenarios import reference_loops
from sim_plants.specs import NEVER, Steps
from tests.monitor.detect.tools import REFERENCE
from tests.support.detection import events_of
from tests.support.plants import samples_of
from tests.support.twins import integrals, load_integrals

FINE = 0.01
"""[s] Backward differences err by about a period over the filter time."""


@pytest.fixture(scope="module")
def reference() -> dict[str, ClosedEvent]:
    """The set-point event of each reference loop, noise-free, in fine time."""
    found = {}
    for loop in reference_loops(0, FINE):
        spec = replace(loop, setpoint=Steps((20.0,), (1.0,)), load=NEVER)
        block = Simulation([spec]).advance(1500.0 if spec.name == "REF-3" else 700.0)
        detector = Detector([Loop(name=spec.name, period=0.2)])
        (found[spec.name],) = events_of(detector.run(samples_of(block)))
    return found


@pytest.mark.parametrize("name", REFERENCE)
def test_integrals_give_gain_and_t0_of_the_reference_loops(reference, name):
    """mu within 0.1 %, T0 within 1 %, from the running integrals of a set-point step alone."""
    event = reference[name]
    gain, t0 = setpoint_integrals(event.amplitude, event.s1, event.s2, event.y1)
    assert event.state == "settled"
    assert gain == pytest.approx(REFERENCE[name][0], rel=1e-3)
    assert t0 == pytest.approx(REFERENCE[name][1], rel=0.01)


@pytest.mark.parametrize("name", REFERENCE)
def test_iae_of_the_reference_loops(reference, name):
    """IAE within 1 % of the published figure, and none of it taken for noise but the settled tail."""
    event = reference[name]
    assert event.iae == pytest.approx(REFERENCE[name][3], rel=0.01)
    assert event.iae_noise == pytest.approx(0.0, abs=1e-6 * event.iae)


@pytest.mark.parametrize("name", ["REF-1", "REF-2", "REF-4"])
def test_load_integrals_give_size_onset_and_gain(name):
    """A load step's size, its onset (which is not measured) and the gain follow from the integrals."""
    (spec,) = (s for s in reference_loops(0, FINE) if s.name == name)
    onset, end = 30.0, 530.0
    spec = replace(spec, setpoint=NEVER, load=Steps((onset,), (1.0,)))
    block = Simulation([spec]).advance(end + FINE)
    window = np.column_stack([(block.time_ns - block.time_ns[0]) * 1e-9, block.sp, block.pv, block.op])
    found = integrals(window, 0.0, 0.0)
    u_end = float(block.op[-1])
    size, age, gain, _ = load_integrals(*(found[n] for n in ("s1", "s2", "s3", "y1", "y2")), u_end)
    assert size == pytest.approx(1.0, rel=1e-3)
    assert window[-1, 0] - age == pytest.approx(onset, abs=0.02)
    assert gain == pytest.approx(REFERENCE[name][0], rel=1e-3)
    assert found["iae"] == pytest.approx(REFERENCE[name][4], rel=0.01)


def test_setpoint_integrals_of_nothing():
    """An OP that balances to zero gives no gain, not an error."""
    gain, t0 = setpoint_integrals(1.0, 0.0, 1.0, 1.0)
    assert math.isnan(gain)
    assert math.isnan(t0)
