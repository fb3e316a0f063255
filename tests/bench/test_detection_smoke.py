"""A few loops of each kind of the benchmark `detection`: it runs, nothing is invented, what happens is found."""

from __future__ import annotations

from dataclasses import replace

import pytest

from tests.bench.detection import HEAD, MOVING, describe, table_line, watch
from tests.bench.detection_fleet import KINDS, fleet, lasts, smallest_peak

SEED = 5
"""Not the benchmark's own."""
KNOWN = [name for name, kind in KINDS.items() if kind.events]


@pytest.mark.parametrize("name", [name for name in KINDS if name not in KNOWN])
def test_nothing_is_invented_in_half_a_loop_week(name: str) -> None:
    outcome = watch(name, 5, 0.1, SEED)
    assert outcome.weeks == pytest.approx(0.5)
    if name not in MOVING:
        assert outcome.false("setpoint") == []
    assert outcome.false("load") == []
    assert outcome.retunes == []
    assert "!" not in table_line(outcome)
    assert name in MOVING or describe(outcome, 5) == ""


@pytest.mark.parametrize("name", KNOWN)
def test_known_steps_are_found(name: str) -> None:
    outcome = watch(name, 8, 1.0, SEED)
    assert outcome.wanted == 8 * 6
    assert outcome.recall >= (0.8 if name == "load" else 0.98)
    assert outcome.precision >= 0.95
    assert len(outcome.matches) <= len(outcome.assessments)
    assert table_line(outcome).startswith(name)
    assert "recall" in HEAD


def test_a_load_is_measured_by_what_it_does_to_pv() -> None:
    """The smallest step of each loop deviates by 5 to 50 standard deviations of the noise."""
    for spec in fleet(KINDS["load"], 6, SEED):
        assert spec.noise > 0
        ratio = smallest_peak(replace(spec, noise=0.0)) / spec.noise
        assert 4.99 <= ratio <= 50.01
        assert lasts(spec) > spec.load.times[-1]
