"""The best gains, and a controller that no table tells of."""

from __future__ import annotations

import math

import numpy as np
import pytest

from monitor.contract.loops import Loop
from monitor.identify.controller import known_of
from monitor.identify.controller_case import Case
from monitor.identify.controller_free import free_fit, without_table
from monitor.identify.controller_rows import lay_out
from monitor.identify.controller_seen import FOUND, UNRESOLVED
from tests.support.controllers import Array, Block, recorded, window_of


def case_of(sp: Array, pv: Array, op: Array) -> Case:
    loop = Loop(name="L")
    rows = lay_out(window_of(sp, pv, op), 1.0, loop)
    assert rows is not None
    return Case(rows, rows, loop, known_of(loop))


@pytest.mark.parametrize("noise", [0.0, 0.1])
@pytest.mark.parametrize(
    "block",
    [
        *(Block(), Block(td=8.0), Block(td=8.0, tf=3.0), Block(ti=math.inf), Block(pv_filter=6.0)),
        *(Block(b=0.0, c=0.0), Block(td=8.0, b=0.0, c=0.0)),
    ],
    ids=["pi", "pid", "long filter", "p", "pv filter", "i-p", "i-pd"],
)
def test_structures_are_found(block: Block, noise: float) -> None:
    found = without_table(case_of(*recorded(block, noise=noise)))
    assert found.said == FOUND
    assert found.settings is not None
    assert found.settings.kp == pytest.approx(block.kp, rel=0.02)
    assert found.settings.ti == pytest.approx(block.ti, rel=0.05)
    assert found.settings.td == pytest.approx(block.td, rel=0.02, abs=0.1)
    assert found.pv_filter == pytest.approx(block.pv_filter, abs=0.05)


def test_a_smeared_step_does_not_bend_the_law() -> None:
    """A historian draws the set point's step over three samples, the output's kick stays where it was."""
    sp, pv, op = recorded(Block(), noise=0.1)
    smeared = sp.copy()
    smeared[127:130] = sp[126] + np.array([0.2, 0.5, 0.8]) * (sp[130] - sp[126])
    _, _, best = free_fit(case_of(smeared, pv, op))
    assert best.gains[0] == pytest.approx(1.5, rel=0.01)
    assert best.gains[0] / best.gains[1] == pytest.approx(80.0, rel=0.02)


def test_noise_alone_that_the_controller_did_not_see_resolves_nothing() -> None:
    rng = np.random.default_rng(0)
    rest = np.full(400, 50.0)
    walk = 50.0 + rng.normal(0.0, 0.1, 400).cumsum()
    assert without_table(case_of(rest, 50.0 + rng.normal(0.0, 0.1, 400), walk)).said == UNRESOLVED
