"""Elements and least squares against plain twins."""

from __future__ import annotations

import math

import numpy as np
import pytest

from monitor.health.valve_fit import (
    AVERAGED_SAMPLES,
    FIELDS,
    FIRST,
    LINEAR,
    OP_LAGS,
    OP_LOW_PASSES,
    SHAPES,
    columns_of,
    feedback_sign,
    fit_block,
    path_of,
)

RNG = np.random.default_rng(3)
N = 600


def wandering(n: int = N, seed: int = 3) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return np.convolve(np.cumsum(rng.normal(size=n)), np.ones(5) / 5, "same")


def element(op: np.ndarray, w: float, shape: str, at: float) -> np.ndarray:
    """The same in plain Python."""
    out = []
    for x in op:
        if shape == "play":
            at = min(max(at, x - w / 2), x + w / 2)
        elif abs(x - at) > w:
            at = x
        out.append(at)
    return np.array(out)


def behind(v: np.ndarray, noise: float, seed: int = 5) -> np.ndarray:
    """PV of a first-order process behind a valve."""
    rng = np.random.default_rng(seed)
    pv, slow = np.zeros(len(v)), v[0]
    for t in range(1, len(v)):
        slow += 0.4 * (v[t - 1] - slow)
        pv[t] = slow
    return pv + noise * rng.normal(size=len(v))


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("start", [-1, 0, 1])
def test_the_path_is_that_of_the_twin(shape: str, start: int) -> None:
    op = wandering()
    v = np.empty(N)
    path_of(op, 3.0, SHAPES.index(shape), start, v)
    assert v == pytest.approx(element(op, 3.0, shape, op[0] + 1.5 * start * (1 - 1e-9)))


def test_play_is_known_once_op_has_passed_the_band() -> None:
    op = wandering()
    v, other = np.empty(N), np.empty(N)
    at = path_of(op, 2.0, 0, -1, v)
    assert at == path_of(op, 2.0, 0, 1, other)
    assert v[at:] == pytest.approx(other[at:])
    assert abs(v[0] - other[0]) == pytest.approx(2.0)


def test_columns_are_the_past() -> None:
    sp, pv, op = np.zeros(N), RNG.normal(size=N), wandering()
    sp[300:] = 2.0
    columns, counts = columns_of(sp, pv, op)
    for level, m in enumerate(AVERAGED_SAMPLES):
        u = (op[: N // m * m].reshape(-1, m).mean(axis=1) - op.mean()) / op.std()
        assert counts[level] == N // m - FIRST
        own = columns[level, :, : counts[level]]
        first = LINEAR - OP_LAGS - len(OP_LOW_PASSES)
        for j in range(OP_LAGS):
            assert own[first + j] == pytest.approx(u[FIRST - 1 - j : len(u) - 1 - j])
        assert 1 <= np.count_nonzero(own[first - 2]) <= 2  # an average may hold the step


@pytest.mark.parametrize("shape", SHAPES)
def test_what_is_left_is_that_of_least_squares(shape: str) -> None:
    """LR against numpy's own least squares, for a path that is known from the first sample on."""
    op = wandering()
    pv = behind(element(op, 3.0, shape, op[0]), 0.3)
    table, starts = fit_block(np.zeros(N), pv, op, np.array([3.0]))
    columns, counts = columns_of(np.zeros(N), pv, op)
    kind, level = SHAPES.index(shape), AVERAGED_SAMPLES.index(1)
    v = np.empty(N)
    at = path_of(op, 3.0, kind, int(starts[kind, 0]) - 1, v)
    n = int(counts[level])
    first = math.ceil(math.ceil(at * 16 / n) * n / 16)
    own = columns[level, :, :n]
    base, linear, y = own[: LINEAR - OP_LAGS - 2], own[:LINEAR], own[LINEAR]
    path, _ = columns_of(np.zeros(N), pv, v)
    past = path[level, LINEAR - OP_LAGS - 2 : LINEAR, :n]

    def left(rows: np.ndarray) -> float:
        fit = np.linalg.lstsq(rows[:, first:].T, y[first:], rcond=None)[0]
        return float(np.sum((y[first:] - fit @ rows[:, first:]) ** 2))

    element_rows = np.concatenate([base, past])
    one = dict(zip(FIELDS, table[level, kind, 0], strict=True))
    assert one["lr"] == pytest.approx(
        (n - first) * math.log(left(linear) / left(element_rows)), rel=1e-3, abs=0.1
    )
    both = (n - first) * math.log(left(element_rows) / left(np.concatenate([linear, past])))
    assert one["miss"] == pytest.approx(both, rel=1e-2, abs=0.5)
    assert one["lr"] > 20.0


def test_a_linear_loop_speaks_against_each_band() -> None:
    op = wandering()
    table, _ = fit_block(np.zeros(N), behind(op, 0.3), op, np.array([1.5, 3.0, 6.0]))
    assert table[AVERAGED_SAMPLES.index(1), :, :, 0].max() < -20.0


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_the_controllers_sign(sign: float) -> None:
    e = wandering(seed=8) + RNG.normal(size=N)
    assert feedback_sign(e, sign * (0.7 * e + 0.05 * np.cumsum(e))) == sign
