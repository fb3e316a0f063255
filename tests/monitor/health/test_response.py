"""An output that goes on without an answer is found; what answers, rests, or is on its way is not."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from monitor.health import response
from monitor.health.response import AVERAGES, LEAST_AVERAGES, no_response_of
from tests.bench.swings_fleet import LOADS, Array, healthy, shut
from tests.monitor.health import plant_records
from tests.monitor.health.cycles import noise


def integrating(
    n: int = 600, error: float = 1.0, kp: float = 0.5, ti: float = 60.0, seed: int = 0
) -> tuple[Array, Array, Array]:
    """SP, PV that stays away from it, and the output of a PI controller."""
    pv = 50.0 - error + 0.05 * noise(n, seed)
    e = 50.0 - pv
    return np.full(n, 50.0), pv, 30.0 + kp * (e + np.cumsum(e) / ti)


def test_an_output_that_integrates_in_vain_is_found_with_its_sides() -> None:
    sp, pv, op = integrating()
    found = no_response_of(sp, pv, op, 1.0, direction=1)
    assert found is not None
    assert found.kind == "no_answer"
    assert (found.start, found.end) == (0, 600)
    assert found.error == pytest.approx(1.0, rel=0.02)
    assert found.op_way == pytest.approx(op[-1] - op[0], rel=0.05)
    assert found.right_way
    assert not found.at_extreme
    wrong = no_response_of(sp, pv, op, 1.0, direction=-1)
    assert wrong is not None
    assert wrong.right_way is False
    unknown = no_response_of(sp, pv, op, 1.0)
    assert unknown is not None
    assert unknown.right_way is None


def test_an_output_that_ends_at_its_limit_is_said_to() -> None:
    sp, pv, op = integrating()
    found = no_response_of(sp, pv, np.minimum(op, op[510]), 1.0)
    assert found is not None
    assert found.at_extreme


def test_an_output_that_hardly_moves_is_a_slow_integral_and_one_at_rest_is_held() -> None:
    slow = no_response_of(*integrating(kp=0.02, ti=20.0), 1.0)
    assert slow is not None
    assert slow.kind == "slow_integral"
    sp, pv, _ = integrating()
    held = no_response_of(sp, pv, np.full(600, 41.3), 1.0, direction=1)
    assert held is not None
    assert held.kind == "held"
    assert held.right_way is None
    assert held.op_way == 0.0


def test_only_the_stretch_without_an_answer_is_meant() -> None:
    sp, pv, op = integrating(n=1000)
    pv[700:] = np.linspace(49.0, 50.0, 300) + 0.05 * noise(300)
    op[700:] = op[700]
    found = no_response_of(sp, pv, op, 1.0)
    assert found is not None
    assert found.end == pytest.approx(800, abs=110)


def test_a_ramp_that_ends_in_a_jump_is_a_sticking_valve() -> None:
    sp, pv, op = integrating(n=800)
    pv[600:] += 1.5
    op[600:] = op[600] - np.cumsum(np.full(200, 0.5)) * 0.5 / 60.0
    assert no_response_of(sp, pv, op, 1.0) is None


def test_an_error_that_comes_back_is_an_answer() -> None:
    t = np.arange(600)
    pv = 50.0 - np.exp(-t / 300.0) + 0.02 * noise(600)
    assert no_response_of(np.full(600, 50.0), pv, 30.0 + 0.01 * t, 1.0) is None


def naive_stays(e: Array, least: float) -> bool:
    """Whether an error keeps its side and its size, in plain NumPy."""
    fifth, half, side = len(e) // 5, len(e) // 2, np.sign(np.mean(e))
    return bool(
        abs(np.mean(e)) >= least
        and np.mean(np.sign(e) == side) >= response.ONE_SIDE_SHARE
        and side * np.mean(e[-fifth:]) >= response.LAST_SHARE * side * np.mean(e[:fifth])
        and side * np.mean(e[half:]) >= response.LATER_SHARE * side * np.mean(e[:half])
    )


@given(seed=st.integers(0, 1000), level=st.floats(-2.0, 2.0))
def test_a_stretch_stays_as_in_plain_numpy(seed: int, level: float) -> None:
    e = level + noise(AVERAGES, seed)
    sums, above = response._sums(e), response._sums((e > 0.0).astype(float))
    for first in range(AVERAGES - LEAST_AVERAGES + 1):
        for last in range(first + LEAST_AVERAGES, AVERAGES + 1):
            found = response._stays(sums, above, first, last, 0.5)
            assert found == naive_stays(e[first:last], 0.5)


def test_averages_and_noise_are_numpys() -> None:
    x = noise(333).cumsum()
    edges = np.arange(AVERAGES + 1) * len(x) // AVERAGES
    parts = [part.mean() for part in np.split(x, edges[1:-1])]
    np.testing.assert_allclose(response._averaged(x), parts, rtol=1e-12)
    beside = x[1:-1] - np.convolve(x, np.full(3, 1 / 3), "valid")
    assert response._noise(x) == pytest.approx(np.std(beside) / np.sqrt(2 / 3))


def test_an_output_that_turns_or_is_within_its_noise_is_not_meant() -> None:
    sp, pv, op = integrating()
    assert no_response_of(sp, pv, 30.0 + np.abs(np.arange(600) % 300 - 150.0) * 0.01, 1.0) is None
    assert no_response_of(sp, pv, op[0] + noise(600), 1.0) is None


def test_too_little_or_missing_data_say_nothing() -> None:
    sp, pv, op = integrating(n=AVERAGES - 1)
    assert no_response_of(sp, pv, op, 1.0) is None
    sp, pv, op = integrating()
    pv[100] = np.nan
    assert no_response_of(sp, pv, op, 1.0) is None
    assert no_response_of(np.zeros(100), np.zeros(100), np.zeros(100), 1.0) is None


@pytest.mark.parametrize("load", LOADS)
def test_healthy_loops_answer(load: str) -> None:
    for seed in range(8):
        r = healthy(np.random.default_rng([11, seed]), load)
        assert no_response_of(r.sp, r.pv, r.op, 1.0) is None


def test_loops_without_an_answer_are_found() -> None:
    rng = np.random.default_rng(12)
    records = [shut(rng) for _ in range(40)]
    assert np.mean([no_response_of(r.sp, r.pv, r.op, 1.0) is not None for r in records]) >= 0.95


@given(
    seed=st.integers(0, 1000),
    scale=st.floats(0.01, 100.0),
    pv_sign=st.sampled_from([-1.0, 1.0]),
    op_sign=st.sampled_from([-1.0, 1.0]),
    offset=st.floats(-100, 100),
)
def test_scales_signs_and_offsets_do_not_matter(
    seed: int, scale: float, pv_sign: float, op_sign: float, offset: float
) -> None:
    sp, pv, op = integrating(seed=seed)
    one = no_response_of(sp, pv, op, 1.0, direction=1)
    other = no_response_of(
        *(pv_sign * scale * (x + offset) for x in (sp, pv)),
        op_sign * op,
        1.0,
        direction=int(pv_sign * op_sign),
    )
    assert one is not None
    assert other is not None
    assert (one.start, one.end, one.kind, one.right_way) == (
        other.start,
        other.end,
        other.kind,
        other.right_way,
    )
    assert other.error == pytest.approx(pv_sign * scale * one.error)


@plant_records.needed
def test_of_a_refinerys_records_those_without_an_answer_are_named_and_no_other() -> None:
    for label, sp, pv, op, period in plant_records.records():
        found = no_response_of(sp, pv, op, period)
        assert (found is not None) == (label == "no_response"), label
