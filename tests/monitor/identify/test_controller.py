"""The controller in simulated loops: what is as the table says, what is beside it, what is against it."""

from __future__ import annotations

import math
from dataclasses import replace

import msgspec
import numpy as np
import pytest

from monitor.contract.loops import Loop
from monitor.detect.event import EventWindow
from monitor.identify.controller import see_controller
from monitor.identify.controller_seen import AS_DECLARED, BESIDE, CONTRADICTED, FOUND, UNRESOLVED, Controller
from tests.support.controllers import Block, recorded, window_of

BLOCKS = {
    "pi": Block(),
    "pid": Block(td=8.0),
    "series": Block(td=8.0, form="series"),
    "p": Block(ti=math.inf),
    "i-pd": Block(td=8.0, b=0.0, c=0.0),
    "clipped": Block(high=56.0),
}
EVENTS = {"setpoint": {"step": 5.0}, "load": {"step": 0.0, "load": 10.0}}


def seen(window: EventWindow, loop: Loop) -> Controller:
    found = see_controller(window, 1.0, loop)
    assert found is not None
    return found


@pytest.mark.parametrize("event", EVENTS)
@pytest.mark.parametrize("block", BLOCKS.values(), ids=list(BLOCKS))
@pytest.mark.parametrize("noise", [0.0, 0.1])
def test_a_right_table_is_confirmed(block: Block, event: str, noise: float) -> None:
    found = seen(window_of(*recorded(block, noise=noise, **EVENTS[event])), block.facts())
    assert found.said == AS_DECLARED
    assert found.delay == 0.0
    assert found.explained == pytest.approx(1.0, abs=1e-3)


def test_a_quiet_stretch_confirms_no_integral_that_it_does_not_show() -> None:
    """Noise goes through the gain to OP, the integral of two minutes is as nothing: a wrong one explains OP as well."""
    slow = Block(ti=6000.0)
    columns = [x[:128] for x in recorded(slow, noise=0.1, step=0.0)]
    for declared in (slow, replace(slow, ti=2400.0)):
        found = seen(window_of(*columns), declared.facts())
        assert found.said == AS_DECLARED
        assert found.kp.high < 1.01 * found.kp.low
        assert found.ti.low < 6000.0 < 1.01 * found.ti.high
    assert found.ti.high > 1.5 * found.ti.low
    sharp = seen(window_of(*columns), slow.facts())
    assert sharp.ti.high < 1.001 * sharp.ti.low


@pytest.mark.parametrize("event", EVENTS)
@pytest.mark.parametrize("noise", [0.0, 0.1])
@pytest.mark.parametrize(
    ("block", "delay"),
    [
        (Block(pv_filter=9.0), 9.0),
        (Block(delay=3), 3.0),
        (Block(pv_filter=5.0, delay=2), 7.0),
        (Block(scan=5), 2.0),
    ],
    ids=["filter", "delay", "both", "scan"],
)
def test_what_lies_beside_the_table_is_found(block: Block, delay: float, event: str, noise: float) -> None:
    found = seen(window_of(*recorded(block, noise=noise, **EVENTS[event])), block.facts())
    assert found.said == BESIDE
    assert found.delay == pytest.approx(delay, rel=0.02)


def test_a_controller_that_runs_between_the_samples() -> None:
    """Each 5 s, recorded each 2 s."""
    columns = [c[::2] for c in recorded(Block(scan=5), n=1200, noise=0.05)]
    found = see_controller(window_of(*columns, before=64, period=2.0), 2.0, Block().facts())
    assert found is not None
    assert found.said == BESIDE
    assert found.scan == pytest.approx(5.0, rel=0.02)
    assert found.delay == pytest.approx(1.5, rel=0.05)


def test_set_point_weights_and_a_ramp_inside_the_block() -> None:
    for noise in (0.0, 0.1):
        found = seen(window_of(*recorded(Block(b=0.0, c=0.0), noise=noise)), Block().facts())
        assert (found.said, found.setpoint_only) == (CONTRADICTED, True)
        assert "no kick" in found.cause
        found = seen(window_of(*recorded(Block(ramp=0.05), noise=noise)), Block().facts())
        assert found.said == BESIDE
        assert "ramp" in found.cause


@pytest.mark.parametrize("noise", [0.0, 0.1])
def test_pv_that_is_recorded_through_a_filter_is_no_derivative(noise: float) -> None:
    sp, pv, op = recorded(Block(), noise=noise)
    smooth = pv.copy()
    for k in range(1, len(pv)):
        smooth[k] = smooth[k - 1] + 0.2 * (pv[k] - smooth[k - 1])
    found = seen(window_of(sp, smooth, op), Block().facts())
    assert found.said == BESIDE
    assert found.delay == 0.0
    assert "recorded through a filter of 4 s" in found.cause


@pytest.mark.parametrize("event", EVENTS)
@pytest.mark.parametrize("noise", [0.0, 0.1])
@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"ti": 80.0 / 60.0}, "minutes"),
        ({"ti": 60.0 / 80.0}, "repeats a minute"),
        ({"ti": 1.0 / 80.0}, "repeats a second"),
        ({"kp": 150.0}, "a percentage for a fraction"),
        ({"kp": -1.5}, "the sign?"),
        ({"kp": 0.3, "op_low": 0.0, "op_high": 100.0, "pv_low": 0.0, "pv_high": 20.0}, "of the spans"),
        ({"kp": 100.0 / 1.5}, "proportional band"),
        ({"kp": 6.0}, "a gain 0.25 times"),
    ],
)
def test_a_wrong_table_is_contradicted_and_the_likely_mistake_named(
    wrong: dict[str, float], words: str, event: str, noise: float
) -> None:
    loop = msgspec.structs.replace(Block().facts(), **wrong)
    found = seen(window_of(*recorded(Block(), noise=noise, **EVENTS[event])), loop)
    assert found.said == CONTRADICTED
    assert words in found.cause
    assert found.settings is not None
    assert found.settings.kp == pytest.approx(1.5, rel=0.02)
    assert found.settings.ti == pytest.approx(80.0, rel=0.02)


def test_series_numbers_in_a_table_of_standard_ones() -> None:
    block = Block(td=12.0, form="series")
    loop = msgspec.structs.replace(block.facts(), form="standard")
    found = seen(window_of(*recorded(block, noise=0.1)), loop)
    assert found.said == CONTRADICTED
    assert "series" in found.cause


@pytest.mark.parametrize("event", EVENTS)
@pytest.mark.parametrize("noise", [0.0, 0.1])
def test_without_a_table_the_settings_are_found(event: str, noise: float) -> None:
    found = seen(window_of(*recorded(Block(), noise=noise, **EVENTS[event])), Loop(name="L"))
    assert found.said == FOUND
    assert found.kp.low <= 1.5 * (1 + 1e-6)
    assert found.kp.value == pytest.approx(1.5, rel=0.05)
    assert found.ti.value == pytest.approx(80.0, rel=0.05)


def test_noise_that_the_controller_did_not_see_accuses_nobody() -> None:
    sp, pv, op = recorded(Block(), noise=0.0)
    for seed in range(5):
        noisy = pv + np.random.default_rng(seed).normal(0.0, 0.1, len(pv))
        found = seen(window_of(sp, noisy, op), Block().facts())
        assert found.said in {AS_DECLARED, UNRESOLVED}
        assert found.delay == 0.0


def test_a_thinned_window_still_tells_minutes() -> None:
    sp, pv, op = recorded(Block(ti=300.0), n=1600)
    mean = 0.5 * (op[0::2] + op[1::2])
    window = replace(window_of(sp[::2], pv[::2], mean, before=64, period=2.0))
    loop = msgspec.structs.replace(Block(ti=300.0).facts(), ti=5.0)
    found = seen(window, loop)
    assert found.said == CONTRADICTED
    assert "minutes" in found.cause


def test_an_output_that_rests_tells_nothing() -> None:
    rest = np.full(200, 50.0)
    assert see_controller(window_of(rest, rest, rest), 1.0, Block().facts()) is None
