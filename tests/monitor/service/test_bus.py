"""What the service asks of a bus is what Zenoh's has, and what the tests' own has: both stand for the same."""

from __future__ import annotations

import pytest

from monitor.adapters import zenoh_bus
from monitor.service.bus import Bus, Question
from tests.support import bus as fake


def asked_for(protocol: type) -> set[str]:
    return {name for name in vars(protocol) if not name.startswith("_")}


@pytest.mark.parametrize("bus", [zenoh_bus.Bus(session=None), fake.FakeBus()], ids=["zenoh", "fake"])
def test_a_bus_has_all_that_is_asked_for(bus):
    assert asked_for(Bus) == {"inbox", "questions", "publish_failed", "twins", "publish"}
    assert not [name for name in asked_for(Bus) if not hasattr(bus, name)]
    assert (len(bus.inbox), len(bus.questions), bus.publish_failed, bus.twins) == (0, 0, 0, 0)


@pytest.mark.parametrize("question", [zenoh_bus.Question, fake.Question])
def test_a_question_can_be_matched_answered_and_refused(question):
    assert not [
        n
        for n in asked_for(Question) - {"key", "parameters", "payload"}
        if not callable(getattr(question, n))
    ]
