"""Which process an event shows, whatever the table calls it."""

from __future__ import annotations

import msgspec
import pytest

from sim_plants.controllers import Controller
from sim_plants.loops import Simulation
from sim_plants.plants import Plant
from sim_plants.specs import LoopSpec, Steps
from tests.support.plants import samples_of, table_of
from tests.support.runs import run


@pytest.mark.parametrize("declared", ["integrating", "self-regulating"])
def test_a_declaration_that_the_data_contradict_is_named(declared):
    """A quick self-regulating process: called integrating it is found to be none, called what it is nothing is said."""
    plant = Plant("self-regulating", 2.0, 5.0, (30.0,))
    spec = LoopSpec("L", plant, Controller(0.5, 30.0), setpoint=Steps((200.0,), (4.0,)), noise=0.02)
    loop = msgspec.structs.replace(table_of([spec])[0], process=declared)
    _, seen = run(loop, samples_of(Simulation([spec]).advance(1200.0)))
    (record,) = seen.assessments
    assert record.process == "self-regulating"
    assert ("the table calls the process integrating" in record.reason) == (declared == "integrating")
    assert record.gain == pytest.approx(2.0, rel=0.05)


def test_a_slope_alone_is_an_integrator():
    """A tank called self-regulating: of its gain and lag only the ratio shows, and that is an integrating process."""
    plant = Plant("integrating", 0.05, 5.0)
    spec = LoopSpec("L", plant, Controller(0.8, 150.0), setpoint=Steps((200.0,), (4.0,)), noise=0.02)
    loop = msgspec.structs.replace(table_of([spec])[0], process="self-regulating")
    _, seen = run(loop, samples_of(Simulation([spec]).advance(2000.0)))
    (record,) = seen.assessments
    assert record.process == "integrating"
    assert "the table calls the process self-regulating" in record.reason
    assert record.gain == pytest.approx(0.05, rel=0.05)
