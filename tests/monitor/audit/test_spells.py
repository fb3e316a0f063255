"""Spells of time against a plain twin, however the record is cut; manual, gaps and bad samples are not watched."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from monitor.audit.spells import FIRST_SPELL_S, MOST_SPELLS, Spells
from monitor.contract.records import Spell
from monitor.contract.samples import Samples

START = 1_772_323_200 * 10**9


def record(hours: float, period: float = 10.0, seed: int = 0) -> Samples:
    """A loop that wanders about its set point."""
    rng = np.random.default_rng(seed)
    n = int(hours * 3600.0 / period)
    time = START + np.round(np.arange(n) * period * 1e9).astype(np.int64)
    return Samples.of(0, time, 50.0, 50.0 + rng.normal(0.2, 0.5, n), 30.0 + rng.normal(0.0, 1.0, n))


def spells_of(samples: Samples, batches: int = 1) -> list[Spell]:
    found = Spells(["LIC-1"])
    for rows in np.array_split(np.arange(len(samples)), batches):
        found.take(samples.take(rows))
    return found.found()


def twin(samples: Samples, width_s: float) -> dict[int, tuple[float, float, float]]:
    """Mean error, its RMS, and OP's way an hour, by a spell's begin: a sample stands until the next."""
    out: dict[int, list[float]] = {}
    for k in range(len(samples) - 1):
        dt = (samples.time[k + 1] - samples.time[k]) * 1e-9
        e = samples.sp[k] - samples.pv[k]
        place = int(samples.time[k] // (width_s * 1e9) * width_s * 1e9)
        sums = out.setdefault(place, [0.0] * 4)
        for j, value in enumerate((dt, dt * abs(e), dt * e * e, abs(samples.op[k + 1] - samples.op[k]))):
            sums[j] += value
    return {
        at: (a / s, (b / s) ** 0.5, p / s * 3600.0) for at, (s, a, b, p) in out.items() if s >= width_s / 2
    }


@pytest.mark.parametrize(("hours", "width"), [(2.0, 600.0), (20.0, 2400.0)])
@pytest.mark.parametrize("batches", [1, 7])
def test_they_equal_a_plain_twin(hours: float, width: float, batches: int) -> None:
    samples = record(hours)
    found, expected = spells_of(samples, batches), twin(samples, width)
    assert [s.start for s in found] == list(expected)
    for spell in found:
        assert (spell.error, spell.error_rms, spell.op_path) == pytest.approx(expected[spell.start])


def test_a_long_record_stays_bounded() -> None:
    found = spells_of(record(24.0 * 400, period=600.0))
    assert MOST_SPELLS / 2 < len(found) <= MOST_SPELLS
    assert {int(b.start - a.start) for a, b in pairwise(found)} == {round(2**11 * FIRST_SPELL_S * 1e9)}


def test_what_is_not_watched_in_automatic_does_not_count() -> None:
    samples = record(4.0)
    n = len(samples)
    samples.auto[: n // 4] = False
    samples.quality[n // 4 : n // 2] = 0
    samples.pv[-n // 4 :] = np.nan
    found = spells_of(samples)
    assert sum(s.seconds for s in found) == pytest.approx(3600.0, rel=0.01)
    gap = record(4.0)
    far = gap.take(np.r_[0 : n // 4, 3 * n // 4 : n])
    assert sum(s.seconds for s in spells_of(far)) == pytest.approx(7200.0, rel=0.01)


def test_a_loop_without_samples_has_none() -> None:
    found = Spells(["A", "B"])
    found.take(record(1.0))
    assert {s.loop for s in found.found()} == {"A"}
