"""A few records of the benchmark `swings`: what is drawn is what is said, and the tables can be printed."""

from __future__ import annotations

import numpy as np
import pytest

from tests.bench import swings as bench
from tests.bench.swings_fleet import BLOCK, LOADS, MOVES, SHAPES, bursts, healthy, moves, shut, swing, wave

SEED = 5
"""Not the benchmark's own."""


@pytest.mark.parametrize("shape", SHAPES)
def test_swings_have_their_cycles(shape: str) -> None:
    assert np.max(np.abs(wave(shape, np.linspace(0.0, 3.0, 301)))) == pytest.approx(1.0, abs=0.03)
    for within in (True, False):
        one = swing(np.random.default_rng(SEED), shape, 6, within)
        ((start, end),) = one.spans
        assert (end - start) / one.period == pytest.approx(6.0, abs=0.2)
        assert (len(one.error) > end - start) == within
    several = bursts(np.random.default_rng(SEED), shape, 0.25)
    assert sum(b - a for a, b in several.spans) == pytest.approx(0.25 * BLOCK, abs=3)


def test_records_are_the_same_for_the_same_seed() -> None:
    for drawn in (lambda r: healthy(r, LOADS[2]), shut, lambda r: moves(r, MOVES[0])):
        one, other = drawn(np.random.default_rng(SEED)), drawn(np.random.default_rng(SEED))
        np.testing.assert_array_equal(one.pv, other.pv)


def test_the_tables_are_printed(capsys: pytest.CaptureFixture[str]) -> None:
    bench.swings(2, SEED)
    bench.false_alarms(1, SEED)
    bench.answers(2, SEED)
    bench.tracking(1, SEED)
    shown = capsys.readouterr().out
    assert all(word in shown for word in (*SHAPES, *LOADS, *MOVES, "bursts", "no response, shut"))
