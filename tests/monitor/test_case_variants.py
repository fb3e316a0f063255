"""Simulated variants of situations of real plants: the same kind, other numbers; each claim of a right answer holds.

What no variant shows yet stands in `SHORT` with its reason: those claims are not asked for.
"""

from __future__ import annotations

import pytest

from monitor.contract.loops import LoopTable
from monitor.contract.records import Assessment
from monitor.engine import Engine
from tests.support.case_variants import draw, faults, makers

SEEDS = (1, 2)
SHORT = {
    "intermittent-hunting": "off for most of the day: hunting takes less than a quarter of the judged time",
    "slow-motor-valve": "a rate-limited valve is named only where its band shows; none is called dangerous",
    "low-select-override": "what the override did is read as other settings before",
    "cascade-slave-in-local": "an event inside the local time carries an index",
    "mixed-units": "the reading of the table says it, not the engine",
}


@pytest.mark.slow
@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("case", sorted(makers().keys() - SHORT.keys()))
def test_a_variant_of_a_case_gets_its_right_answer(case, seed):
    """Nothing that must not be said, nothing that must be left out, no settings that harm the true loop."""
    wrong = []
    for variant in draw(case, seed):
        engine = Engine(LoopTable([variant.loop]))
        records = [*engine.step(variant.samples), *engine.flush()]
        row = engine.row(0)
        broken = faults(variant, row, [r for r in records if isinstance(r, Assessment)])
        if broken:
            wrong.append((variant.loop.name, broken, row.verdict, row.reason))
    assert not wrong


@pytest.mark.slow
@pytest.mark.parametrize("case", sorted(SHORT))
def test_what_is_not_named_yet_does_no_harm(case):
    """Whatever is said of these: no settings that bring the true loop near instability."""
    for variant in draw(case, 1):
        engine = Engine(LoopTable([variant.loop]))
        engine.step(variant.samples)
        engine.flush()
        law = variant.suggested(engine.row(0))
        assert law is None or variant.ms(law) <= 3.0
