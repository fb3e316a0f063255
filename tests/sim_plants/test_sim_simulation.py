"""Simulation: known loops, a naive twin, and what a simulation has to keep to."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sim_plants.controllers import Controller
from sim_plants.fleet import random_fleet
from sim_plants.loops import NEVER, LoopSpec, Simulation, Steps
from sim_plants.plants import Plant
from sim_plants.scenarios import reference_loops
from tests.sim_plants.sim_twin import simulate

# IAE of a unit step of the set point and of the load, mu, T0. Series PID,
# continuous controller; the third figure of each is good to about 0.1 %.
REFERENCE = {
    "REF-1": (3.922, 16.0, 1.0, 1.0),
    "REF-2": (2.272, 4.0, 1.0, 2.0),
    "REF-3": (33.98, 320.0, 0.2, 8.0),
    "REF-4": (17.64, 50.0, 0.2, 8.0),
}
FINE = 0.005  # [s] backward differences err by about a period over the filter time


def columns(block, loop):
    rows = block.rows(block.loop == loop)
    return rows.time_ns, rows.sp, rows.pv, rows.op


@pytest.fixture(scope="module")
def reference():
    """Responses to a unit step of the set point and of the load at time 0, per loop: e, y, u."""
    result = {}
    loops = [replace(loop, period=FINE) for loop in reference_loops(0)]
    for kind in ("setpoint", "load"):
        once = Steps((0.0,), (1.0,))
        which = {"setpoint": NEVER, "load": NEVER} | {kind: once}
        block = Simulation([replace(loop, **which) for loop in loops]).advance(1800.0)
        for i, loop in enumerate(loops):
            _, sp, pv, op = columns(block, i)
            result[loop.name, kind] = (sp - pv, pv, op)
    return result


@pytest.mark.parametrize("name", REFERENCE)
def test_reference_loop_iae(reference, name):
    iae_sp, iae_ld, *_ = REFERENCE[name]
    assert np.abs(reference[name, "setpoint"][0]).sum() * FINE == pytest.approx(iae_sp, rel=0.01)
    assert np.abs(reference[name, "load"][0]).sum() * FINE == pytest.approx(iae_ld, rel=0.001)


@pytest.mark.parametrize("name", REFERENCE)
def test_set_point_step_gives_gain_and_t0_by_integrals(reference, name):
    """Veronesi and Visioli (2010): mu = Ar / int u, T0 = int (mu int u - y) / Ar; OP held between samples."""
    _, y, u = reference[name, "setpoint"]
    *_, gain, t0 = REFERENCE[name]
    estimate = 1.0 / (u.sum() * FINE)
    assert estimate == pytest.approx(gain, rel=1e-3)
    moved = np.concatenate([[0.0], np.cumsum(u[:-1]) * FINE])
    assert np.trapezoid(estimate * moved - y, dx=FINE) == pytest.approx(t0, rel=2e-3)


@pytest.mark.parametrize("name", REFERENCE)
def test_load_step_gives_gain_by_integrals_and_is_cancelled(reference, name):
    """Ad = -u(inf), mu = int y / int int v with v = u + Ad."""
    _, y, u = reference[name, "load"]
    assert u[-1] == pytest.approx(-1.0, abs=1e-5)
    once = np.concatenate([[0.0], np.cumsum((u + 1.0)[:-1]) * FINE])
    assert np.trapezoid(y, dx=FINE) / np.trapezoid(once, dx=FINE) == pytest.approx(
        REFERENCE[name][2], rel=2e-3
    )


PLANT = Plant("integrating", -0.05, 3.4, (4.0, 1.0))
SLOW = Plant("self-regulating", 1.7, 2.0, (9.0,))
WIDE = {"op_low": 0.0, "op_high": 100.0}
TWINS = [
    (PLANT, Controller(-1.5, 60.0)),
    (PLANT, Controller(-1.5, 60.0, 4.0, form="series")),
    (PLANT, Controller(-1.5, 60.0, 4.0, b=0.0, c=0.0, form="series")),
    (PLANT, Controller(-1.5, 60.0, 4.0, c=0.0, form="series", **WIDE)),
    (PLANT, Controller(-1.5, 60.0, 4.0, tf=0.0, form="standard")),
    (PLANT, Controller(-1.5, 60.0, 4.0, b=0.4, c=0.3, form="parallel", **WIDE)),
    (PLANT, Controller(-1.5)),
    (PLANT, Controller(-1.5, td=5.0, form="series")),
    (SLOW, Controller(0.8, 9.0)),
    (SLOW, Controller(0.8, 9.0, op_low=48.0, op_high=53.0)),
    (SLOW, Controller(3.0, 9.0, 2.0, op_low=48.0, op_high=53.0, anti_windup="none")),
    (SLOW, Controller(3.0, 9.0, 2.0, op_low=48.0, op_high=53.0, anti_windup="tracking")),
    (SLOW, Controller(0.8, 9.0, op_low=48.0, op_high=53.0, anti_windup="tracking", tracking_time=6.0)),
]


@pytest.mark.parametrize("extra", [{}, {"quantum": 0.1}, {"stiction": 0.8}], ids=str)
@pytest.mark.parametrize(("plant", "controller"), TWINS, ids=str)
def test_equals_the_naive_twin(plant, controller, extra):
    loop = LoopSpec(
        "LIC-1",
        plant,
        controller,
        pv0=30.0,
        op0=50.0,
        period=0.5,
        setpoint=Steps((5.0, 80.0), (2.0, -3.0)),
        load=Steps((150.0,), (6.0,)),
        **extra,
    )
    _, sp, pv, op = columns(Simulation([loop]).advance(300.0), 0)
    expected = np.array(simulate(loop, 600))
    np.testing.assert_allclose(np.column_stack([sp, pv, op]), expected, rtol=0, atol=1e-7)


def test_limits_hold_and_anti_windup_saves_the_overshoot():
    def run(anti_windup):
        controller = Controller(2.0, 5.0, op_low=40.0, op_high=55.0, anti_windup=anti_windup)
        loop = LoopSpec("FIC-1", SLOW, controller, op0=50.0, setpoint=Steps((10.0,), (8.0,)))
        _, sp, pv, op = columns(Simulation([loop]).advance(400.0), 0)
        assert op.min() >= 40.0
        assert op.max() == 55.0
        return (pv - sp).max()

    assert run("conditional") < 0.5 * run("none")
    assert run("tracking") < 0.5 * run("none")


def test_bumpless_from_manual_to_automatic():
    loop = LoopSpec(
        "LIC-1",
        PLANT,
        Controller(-1.5, 60.0),
        op0=50.0,
        auto=False,
        modes=Steps((120.0,), (1.0,)),
        output=Steps((20.0, 40.0, 150.0), (2.0, -2.5, 30.0)),
        setpoint=Steps((10.0,), (3.0,)),
    )
    block = Simulation([loop]).advance(2000.0)
    _, sp, pv, op = columns(block, 0)
    assert not block.auto[:120].any()
    assert block.auto[120:].all()
    np.testing.assert_array_equal(np.unique(op[:120]), [49.5, 50.0, 52.0])
    # The move at the switch is what P and I make of one sample, not of the error of -3 that stands there.
    assert (
        abs(op[120] - op[119]) < abs(-1.5 * (pv[120] - pv[119])) + abs(1.5 / 60 * (sp[120] - pv[120])) + 1e-9
    )
    assert abs(sp[-1] - pv[-1]) < 0.02


def test_a_load_between_samples_acts_at_its_instant():
    """The same loop in manual at a tenth of the period gives the same PV at the samples both have."""
    loop = LoopSpec(
        "TIC-1", PLANT, Controller(-1.0), auto=False, load=Steps((3.37, 9.0, 11.999), (1.0, -3.0, 2.0))
    )
    coarse = Simulation([loop]).advance(40.0).pv
    fine = Simulation([replace(loop, period=0.1)]).advance(40.0).pv[::10]
    np.testing.assert_allclose(coarse, fine, atol=1e-12)
    assert np.abs(coarse).max() > 0.1


def test_steps_repeat_for_ever():
    loop = LoopSpec(
        "LIC-1",
        PLANT,
        Controller(-1.0),
        setpoint=Steps((3.0, 95.0), (1.0, -1.0), 100.0),
        load=Steps((99.5,), (1.0,), 100.0),
        auto=False,
    )
    block = Simulation([loop]).advance(1000.0)
    at = np.flatnonzero(np.diff(block.sp))
    np.testing.assert_array_equal(
        at + 1, np.sort(np.concatenate([np.arange(3, 1000, 100), np.arange(95, 1000, 100)]))
    )
    # Integrators in manual: ten loads, each from its time on, ramp PV.
    ramp = -0.05 * np.maximum(999.0 - (99.5 + 3.4 + 5.0) - 100.0 * np.arange(9), 0).sum()
    assert block.pv[-1] == pytest.approx(ramp, rel=1e-6)
    assert [t for t, _ in loop.setpoint.until(200.0)] == [3.0, 95.0, 103.0, 195.0]


MIXED = [
    replace(loop, period=period, setpoint=setpoint, load=load, wander=0.01, stiction=0.05, quantum=0.001)
    for loop, period, setpoint, load in zip(
        random_fleet(5, 3),
        (1.0, 0.25, 1.0, 2.0, 0.1),
        (Steps((4.0, 9.0), (1.0, -1.0), 12.0), NEVER, Steps((0.0,), (1.0,)), NEVER, Steps((7.7,), (1.0,))),
        (NEVER, Steps((3.3, 5.1), (2.0, -2.0), 10.0), NEVER, Steps((1.0,), (2.0,)), NEVER),
        strict=True,
    )
]


@settings(max_examples=20)
@given(st.lists(st.integers(0, 20_000_000), min_size=1, max_size=12))
def test_how_time_is_cut_makes_no_difference(pieces):
    """Pieces in microseconds, down to none and across samples."""
    cut, whole = Simulation(MIXED), Simulation(MIXED)
    parts = [cut.advance(piece * 1e-6) for piece in pieces]
    total = whole.advance(sum(pieces) * 1e-6)
    for name in ("loop", "time_ns", "sp", "pv", "op", "auto"):
        joined = np.concatenate([getattr(part, name) for part in parts])
        np.testing.assert_array_equal(joined, getattr(total, name))
    assert cut.time_ns == whole.time_ns


def test_samples_are_in_the_order_of_time_then_loop():
    start = 1_800_000_000.123456
    block = Simulation(MIXED, start).advance(20.0)
    key = block.time_ns * 10 + block.loop
    assert (np.diff(key) > 0).all()
    counts = np.bincount(block.loop)
    np.testing.assert_array_equal(counts, [20, 80, 20, 10, 200])
    assert block.time_ns[0] == 1_800_000_000_123_456_000
    assert block.time[0] == pytest.approx(start, abs=1e-6)


def test_a_loop_does_not_depend_on_its_neighbours():
    alone = Simulation([MIXED[1]]).advance(100.0)
    together = Simulation(MIXED).advance(100.0)
    np.testing.assert_array_equal(alone.pv, together.pv[together.loop == 1])


def test_noise_is_white_normal_and_seeded():
    loop = LoopSpec("FIC-1", SLOW, Controller(0.8, 9.0), noise=0.3, seed=5, auto=False)
    pv = Simulation([loop]).advance(50_000.0).pv
    assert pv.std() == pytest.approx(0.3, rel=0.02)
    assert abs(pv.mean()) < 4 * 0.3 / np.sqrt(50_000)
    z = pv / 0.3
    assert abs((z**3).mean()) < 0.05
    assert (z**4).mean() == pytest.approx(3.0, abs=0.15)
    assert np.abs(np.correlate(z, z[:49_990], "valid")[1:] / 50_000).max() < 0.02
    np.testing.assert_array_equal(Simulation([loop]).advance(100.0).pv, pv[:100])
    assert not np.array_equal(Simulation([replace(loop, seed=6)]).advance(100.0).pv, pv[:100])


def test_wander_grows_as_the_root_of_time():
    plants = [
        LoopSpec(
            f"L{i}",
            Plant("self-regulating", 1.0, 0.0, (0.01,)),
            Controller(1.0),
            auto=False,
            wander=0.1,
            seed=i,
        )
        for i in range(400)
    ]
    block = Simulation(plants).advance(401.0)
    last = block.pv[block.time_ns == block.time_ns.max()]
    assert last.std() == pytest.approx(0.1 * 20.0, rel=0.12)


def correlation(x, lag):
    return float(np.corrcoef(x[:-lag], x[lag:])[0, 1])


def test_coloured_noise_keeps_its_spread_and_has_its_correlation_time():
    loop = LoopSpec("FIC-1", SLOW, Controller(0.8, 9.0), noise=0.3, noise_time=20.0, seed=5, auto=False)
    pv = Simulation([loop]).advance(200_000.0).pv
    assert pv.std() == pytest.approx(0.3, rel=0.05)
    assert correlation(pv, 20) == pytest.approx(np.exp(-1), abs=0.05)


def test_a_wandering_load_that_comes_back_stays_bounded():
    fast = Plant("self-regulating", 1.0, 0.0, (0.01,))
    loop = LoopSpec("L", fast, Controller(1.0), auto=False, wander=0.1, wander_time=50.0, seed=1)
    pv = Simulation([loop]).advance(200_000.0).pv
    assert pv.std() == pytest.approx(0.1 * np.sqrt(50.0 / 2), rel=0.05)
    assert correlation(pv, 50) == pytest.approx(np.exp(-1), abs=0.05)


def test_a_set_point_with_a_rate_ramps_to_where_its_steps_send_it():
    ramp = Steps((10.0, 12.0), (1.0, 1.0))
    sp = (
        Simulation([LoopSpec("L", SLOW, Controller(0.8, 9.0), setpoint=ramp, setpoint_rate=0.25)])
        .advance(30.0)
        .sp
    )
    np.testing.assert_allclose(sp, np.clip((np.arange(30) - 9) * 0.25, 0.0, 2.0), atol=1e-12)


def test_a_master_moves_the_set_point_at_its_scans():
    loop = LoopSpec("L", SLOW, Controller(0.8, 9.0), master=2.0, master_time=40.0, master_scan=4.0, seed=3)
    sp = Simulation([loop]).advance(400_000.0).sp
    moves = np.flatnonzero(np.diff(sp)) + 1
    assert np.all(moves % 4 == 0)
    assert len(moves) > 90_000
    assert sp.std() == pytest.approx(2.0, rel=0.05)
    assert correlation(sp, 40) == pytest.approx(np.exp(-1), abs=0.05)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"wander_time": 0.0}, "wander_time: 0.0, expected"),
        ({"master": -1.0}, "master: -1.0, expected"),
        ({"noise": -1.0}, "loop 'LIC-1': noise: -1.0, expected"),
        ({"period": 0.0}, "loop 'LIC-1': period: 0.0, expected"),
        ({"name": ""}, "name: '', expected a tag"),
        ({"objective": "fun"}, "objective: 'fun', expected one of setpoint, load, both, averaging"),
        ({"op0": 120.0, "controller": Controller(1.0, **WIDE)}, "op0: 120.0, expected a number within"),
        ({"modes": Steps((1.0,), (1.0,))}, "modes"),
        ({"setpoint": Steps((1.0,), (1.0,), 10.25)}, "multiple of the period"),
        ({"pv_low": 2.0, "pv_high": 1.0}, "pv_low: 2.0, expected"),
    ],
)
def test_a_bad_loop_is_refused_by_name_field_and_value(change, message):
    with pytest.raises(ValueError, match=message):
        replace(LoopSpec("LIC-1", PLANT, Controller(-1.0)), **change)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (((1.0, 1.0), (1.0, 1.0)), "times"),
        (((-1.0,), (1.0,)), "times"),
        (((1.0,), (1.0, 2.0)), "sizes"),
        (((1.0, 9.0), (1.0, 2.0), 8.0), "repeat: 8.0, expected seconds above"),
    ],
)
def test_bad_steps_are_refused(arguments, message):
    with pytest.raises(ValueError, match=message):
        Steps(*arguments)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"kp": 0.0}, "kp: 0.0, expected"),
        ({"ti": 0.0}, "ti: 0.0, expected"),
        ({"td": -1.0}, "td: -1.0, expected"),
        ({"tf": np.nan}, "tf: nan, expected"),
        ({"b": np.inf}, "b: inf, expected"),
        ({"form": "ideal"}, "form: 'ideal', expected one of standard, series, parallel"),
        ({"anti_windup": "off"}, "anti_windup: 'off', expected one of"),
        ({"op_low": 5.0, "op_high": 5.0}, "op_low: 5.0, expected"),
    ],
)
def test_a_bad_controller_is_refused(change, message):
    with pytest.raises(ValueError, match=message):
        replace(Controller(1.0, 10.0), **change)


def test_no_loops_or_two_of_a_name_are_refused():
    with pytest.raises(ValueError, match="at least one"):
        Simulation([])
    with pytest.raises(ValueError, match="same name"):
        Simulation([MIXED[0], MIXED[0]])
