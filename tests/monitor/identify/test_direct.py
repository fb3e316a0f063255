"""An event's window to a model: the response, the fit's accuracy and honesty, several events together."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from monitor.contract.loops import Loop
from monitor.detect.detector import Detector
from monitor.detect.event import ClosedEvent, EventWindow
from monitor.identify.direct import fit_kinds, fit_window, model_response
from monitor.identify.fit import Fit, combine, contradictory, decide
from monitor.identify.integrals import setpoint_integrals
from monitor.identify.projection import blocks
from monitor.identify.response import load_response
from monitor.identify.response import response as fast_response
from monitor.identify.uncertainty import correlation_time
from sim_plants.controllers import Controller
from sim_plants.loops import Simulation
from sim_plants.plants import Plant
from sim_plants.settings import simc
from sim_plants.specs import LoopSpec, Steps
from tests.support.fits import make_fit
from tests.support.plants import pi_loop, samples_of
from tests.support.twins import response
from tuners.models import INTEGRATING, SELF_REGULATING

BEFORE = 60


def window_of(
    plant: Plant, controller: Controller, seconds: float, noise: float = 0.0, seed: int = 0
) -> EventWindow:
    """Window of a set-point step of 1 after 60 samples of rest, 1 s a sample."""
    spec = LoopSpec(
        name="L",
        plant=plant,
        controller=controller,
        setpoint=Steps((float(BEFORE),), (1.0,)),
        noise=noise,
        seed=seed,
    )
    block = Simulation([spec]).advance(BEFORE + seconds)
    t = (block.time_ns - block.time_ns[0]) * 1e-9 - BEFORE
    return EventWindow(t, block.sp, block.pv, block.op, BEFORE)


def without_point(window: EventWindow, k: int) -> EventWindow:
    """The window, one sample after the onset lost."""
    columns = (np.delete(column, k) for column in (window.time, window.sp, window.pv, window.op))
    return EventWindow(*columns, window.before)


def random_plant(rng: np.random.Generator, process: str = INTEGRATING) -> Plant:
    """A plant of no or one lag: the model's own order, so that a fit can be exact."""
    dead_time = float(rng.uniform(2.0, 12.0))
    lags = (float(dead_time * rng.uniform(0.3, 4.0)),)
    gain = float(rng.choice([-1, 1]) * np.exp(rng.uniform(-5, 1)))
    if process == INTEGRATING:
        return Plant("integrating", gain, dead_time, lags if rng.random() < 0.7 else ())
    return Plant("self-regulating", gain, dead_time, lags)


# ---------------------------------------------------------------------------------------------------
# the model's response


@settings(max_examples=25, deadline=None)
@given(
    steps=st.lists(st.floats(0.05, 1.5), min_size=6, max_size=25),
    kind=st.sampled_from([0, 1]),
    dead_time=st.floats(0.0, 6.0),
    lag=st.sampled_from([0.0, 0.3, 1.0, 4.0]),
    lag2=st.sampled_from([0.0, 0.5, 1.0, 4.0]),
    seed=st.integers(0, 1000),
)
@example([0.3] * 10, 1, 0.7, 1.0, 1.0, 1)
@example([0.3] * 10, 0, 50.0, 1.0, 0.0, 1)
@example([0.3] * 10, 0, 0.7, 4.0, 1.0, 1)
@example([0.3] * 10, 0, 0.7, 1.0, 1.0, 1)
@example([0.3] * 10, 1, 0.0, 0.0, 0.0, 1)
@example(
    [0.5] * 10, 1, 0.5, 0.0, 0.0, 1
)  # dead times as long as one step and as three, exact numbers and not
@example([0.3] * 10, 1, 0.3, 0.0, 0.0, 1)
@example([0.3] * 10, 1, 0.9, 0.0, 0.0, 1)
@example([0.3] * 10, 0, 0.9, 0.0, 0.0, 1)
def test_response_equals_its_naive_twin(steps, kind, dead_time, lag, lag2, seed):
    """Exact for held input at uneven times, any dead time, no lag; equal lags are taken a thousandth apart."""
    if lag < lag2:
        lag2 = 0.0
    t = np.cumsum(np.array(steps)) - 1.0
    u = np.random.default_rng(seed).normal(size=len(t))
    fast = fast_response(t, u, kind, dead_time, lag, lag2)
    slow = response(t, u, kind, dead_time, lag, lag2)
    scale = max(1.0, float(np.max(np.abs(u)))) * max(1.0, float(np.ptp(t)) if kind == 0 else 1.0)
    assert np.max(np.abs(fast - slow)) < (1e-3 if lag == lag2 != 0.0 else 1e-9) * scale


def test_response_to_a_step_is_the_textbooks():
    """A ramp after dead time and lag; a first-order rise."""
    t = np.arange(0.0, 60.0)
    u = np.ones(60)
    after = np.maximum(t - 7.5, 0.0)
    ramp = after - 4.0 * (1 - np.exp(-after / 4.0))
    np.testing.assert_allclose(fast_response(t, u, 0, 7.5, 4.0, 0.0), ramp, atol=1e-12)
    np.testing.assert_allclose(fast_response(t, u, 1, 7.5, 4.0, 0.0), 1 - np.exp(-after / 4.0), atol=1e-12)


@settings(max_examples=25, deadline=None)
@given(
    kind=st.sampled_from([0, 1]),
    onset=st.integers(0, 20),
    dead_time=st.floats(0.0, 9.0),
    lag=st.sampled_from([0.0, 0.3, 4.0]),
    lag2=st.sampled_from([0.0, 0.2, 4.0]),
    seed=st.integers(0, 1000),
)
def test_a_load_acts_as_op_does(kind, onset, dead_time, lag, lag2, seed):
    """A load step at a sample's instant moves PV as OP's own step there does, at uneven times."""
    if lag < lag2:
        lag2 = 0.0
    t = np.cumsum(np.random.default_rng(seed).choice([0.5, 0.5, 1.0], size=60))
    by_op = fast_response(t, (np.arange(60) >= onset).astype(float), kind, dead_time, lag, lag2)
    by_load = load_response(t - t[onset], kind, 1.0, dead_time, lag, lag2)
    at_the_jump = (lag == 0.0) & (np.abs(t - t[onset] - dead_time) < 1e-9)  # before or after: both are right
    np.testing.assert_allclose(by_load[~at_the_jump], by_op[~at_the_jump], atol=1e-9)


@settings(max_examples=25, deadline=None)
@given(n=st.integers(12, 900), most=st.integers(10, 300), seed=st.integers(0, 1000))
def test_blocks_keep_the_integral_of_op(n, most, seed):
    """However a window is thinned: OP's integral at each block's start is that of all points, PV the mean."""
    rng = np.random.default_rng(seed)
    t, u, y = np.cumsum(rng.uniform(0.5, 1.5, n)), rng.normal(size=n), rng.normal(size=n)
    at, mean, since, held = blocks(t, u, y, most)
    size = -(-n // most)
    assert len(at) == n // size
    whole = np.concatenate([[0.0], np.cumsum(u[:-1] * np.diff(t))])
    thinned = np.concatenate([[0.0], np.cumsum(held[:-1] * np.diff(since))])
    np.testing.assert_allclose(thinned, whole[: len(at) * size : size], atol=1e-9)
    assert mean[-1] == pytest.approx(y[(len(at) - 1) * size : len(at) * size].mean())


# ---------------------------------------------------------------------------------------------------
# the fit


@pytest.mark.parametrize("seed", range(12))
def test_fit_is_exact_without_noise(seed):
    """On a plant of the model's own order: gain within 0.1 %, T0 and dead time within 1 % of T0 or a tenth period."""
    rng = np.random.default_rng(seed)
    plant = random_plant(rng)
    base = simc(plant, 1.0)
    controller = replace(
        base, kp=base.kp * float(rng.uniform(0.3, 1.0)), ti=base.ti * float(rng.uniform(0.7, 3.0))
    )
    fit = fit_window(window_of(plant, controller, 500.0), INTEGRATING)
    assert fit is not None
    assert fit.gain == pytest.approx(plant.gain, rel=1e-3)
    near = max(0.01 * plant.t0, 0.1)
    assert fit.t0 == pytest.approx(plant.t0, abs=near)
    assert fit.dead_time == pytest.approx(plant.dead_time, abs=2 * near)
    assert fit.quality > 0.99999


@pytest.mark.parametrize("seed", range(8))
def test_fit_of_a_self_regulating_plant_is_exact_without_noise(seed):
    """The same for first order plus dead time."""
    rng = np.random.default_rng(100 + seed)
    plant = random_plant(rng, SELF_REGULATING)
    fit = fit_window(window_of(plant, simc(plant, 1.0), 500.0), SELF_REGULATING)
    assert fit is not None
    assert fit.gain == pytest.approx(plant.gain, rel=5e-3)
    assert fit.t0 == pytest.approx(plant.t0, rel=0.02)


@pytest.fixture(scope="module")
def noisy() -> list[tuple[Plant, Fit]]:
    """A hundred loops at 1 % of noise, fitted from one set-point step each."""
    found = []
    for seed in range(100):
        rng = np.random.default_rng(1000 + seed)
        plant = random_plant(rng)
        base = simc(plant, 1.0)
        controller = replace(base, kp=base.kp * float(rng.uniform(0.3, 1.0)))
        seconds = 60 * plant.t0
        fit = fit_window(window_of(plant, controller, seconds, 0.01, seed), INTEGRATING)
        assert fit is not None
        found.append((plant, fit))
    return found


def test_gains_interval_covers_the_truth(noisy):
    """At 1 % noise the 95 % interval of the gain holds the true gain in at least 90 of 100 loops."""
    inside = sum(fit.interval("gain")[0] <= plant.gain <= fit.interval("gain")[1] for plant, fit in noisy)
    assert inside >= 90


def test_intervals_are_of_use(noisy):
    """They are not bought by width: the gain's is below 15 % either way in the median."""
    widths = [math.log(abs(fit.interval("gain")[1] / fit.interval("gain")[0])) for _, fit in noisy]
    assert np.median(np.abs(widths)) < 0.3


def test_t0_at_one_percent_of_noise(noisy):
    """T0 within 15 % in at least 95 of 100 loops."""
    assert sum(abs(fit.t0 / plant.t0 - 1) < 0.15 for plant, fit in noisy) >= 95


def test_interval_of_dead_time_covers_the_truth(noisy):
    """In at least 85 of 100: noise that travels round the loop biases a direct fit."""
    inside = sum(
        fit.interval("dead_time")[0] <= plant.dead_time <= fit.interval("dead_time")[1]
        for plant, fit in noisy
    )
    assert inside >= 85


@pytest.mark.parametrize("process", [INTEGRATING, SELF_REGULATING])
def test_kind_of_process_is_right_or_left_open(process):
    """Never decided wrongly at 0.5 % noise; decided at all in most loops that had time to settle."""
    decided_right = 0
    for seed in range(20):
        rng = np.random.default_rng(seed)
        plant = random_plant(rng, process)
        seconds = 40 * plant.t0
        window = window_of(plant, simc(plant, 1.0), seconds, 0.005, seed)
        fits = [fit_window(window, kind) for kind in (INTEGRATING, SELF_REGULATING)]
        best, sure = decide([f for f in fits if f is not None], seconds)
        assert best is not None
        if sure:
            assert best.process == process
            decided_right += 1
    assert decided_right >= 15


def test_a_short_window_is_left_undecided_or_integrating():
    """A lag of 600 s seen for 60 s is an integrator to the eye, or nothing can be said."""
    plant = Plant("self-regulating", 3.0, 4.0, (600.0,))
    window = window_of(plant, Controller(10.0, 60.0), 60.0, 0.005)
    fits = [fit_window(window, kind) for kind in (INTEGRATING, SELF_REGULATING)]
    best, sure = decide([f for f in fits if f is not None], 60.0)
    assert best is not None
    assert not (sure and best.process == SELF_REGULATING)


def load_event(plant: Plant, controller: Controller, noise: float, seed: int) -> EventWindow | None:
    """Window of a load step of 5 between samples; None where it is not noticed."""
    spec = LoopSpec(
        name="L", plant=plant, controller=controller, load=Steps((150.4,), (5.0,)), noise=noise, seed=seed
    )
    detector = Detector([Loop(name="L")])
    found = detector.run(samples_of(Simulation([spec]).advance(150 + 40 * plant.t0))) + detector.flush()
    windows = [e.window for e in found if isinstance(e, ClosedEvent)]
    return windows[0] if windows else None


def with_second_lag(seed: int) -> tuple[Plant, Controller]:
    """A self-regulating plant of two lags under a PI that is slower than SIMC's."""
    rng = np.random.default_rng(seed)
    dead_time = float(rng.uniform(3.0, 8.0))
    first = dead_time * float(rng.uniform(2.0, 10.0))
    plant = Plant("self-regulating", 2.0, dead_time, (first, first * float(rng.uniform(0.05, 0.4))))
    base = simc(plant, 1.0)
    return plant, replace(base, kp=base.kp * float(rng.uniform(0.3, 1.0)), td=0.0)


@pytest.fixture(scope="module")
def after_loads() -> list[tuple[Plant, list[Fit]]]:
    """Forty self-regulating plants after a load step at 1 % of noise, both kinds fitted."""
    found = []
    for seed in range(40):
        plant, controller = with_second_lag(seed)
        event = load_event(plant, controller, 0.02, seed)
        if event is not None:
            found.append((plant, fit_kinds(event, [INTEGRATING, SELF_REGULATING], True, 1.0)))
    assert len(found) >= 35
    return found


def test_a_load_step_shows_the_gain_of_a_self_regulating_process(after_loads):
    """To some percent in the median, where dead time, lags, gain and onset are told apart at all."""
    errors = [abs(fits[1].gain / plant.gain - 1) for plant, fits in after_loads]
    assert np.median(errors) < 0.08
    assert np.mean([abs(fits[1].t0 / plant.t0 - 1) < 0.15 for plant, fits in after_loads]) > 0.85


def test_intervals_after_a_load_step_cover_the_truth(after_loads):
    """Of gain, T0 and the half rule's dead time, in nine of ten at least."""
    inside = np.array(
        [
            [
                fit.interval("gain")[0] <= plant.gain <= fit.interval("gain")[1],
                fit.interval("t0")[0] <= plant.t0 <= fit.interval("t0")[1],
                abs(fit.dead_time + fit.lag2 / 2 - plant.half_rule()[0]) <= 1.96 * math.sqrt(fit.cov[2, 2]),
            ]
            for plant, (_, fit) in after_loads
        ]
    )
    assert (inside.mean(axis=0) >= 0.9).all()


def test_the_kind_is_seen_after_a_load_step(after_loads):
    """Self-regulating, or one with so long a lag that it is tuned as an integrating one."""
    decided = [decide(fits, 1e9) for _, fits in after_loads]
    assert (
        np.mean([best is not None and best.process == SELF_REGULATING and sure for best, sure in decided])
        > 0.9
    )
    for seed in range(8):
        plant = random_plant(np.random.default_rng(seed))
        event = load_event(plant, simc(plant, 1.0), 0.1 * abs(plant.gain), seed)
        if event is not None:
            best, sure = decide(fit_kinds(event, [INTEGRATING, SELF_REGULATING], True, 1.0), 1e9)
            assert best is not None
            assert not (sure and best.process == SELF_REGULATING)


def test_the_valley_lies_about_the_fit(after_loads):
    """A way of models from less to more dead time, the best among them, none better than the best."""
    for _, (integrating, fit) in after_loads:
        assert integrating.valley is None
        if fit.valley is None:  # not believed
            continue
        assert (np.diff(fit.valley.models[:, 2]) >= 0).all()
        assert fit.valley.deficit.min() == 0.0
        assert (fit.valley.deficit >= 0).all()
        assert fit.valley.models[0, 2] - 0.5 <= fit.dead_time <= fit.valley.models[-1, 2] + 0.5
        assert np.linalg.eigvalsh(fit.valley.across).min() >= -1e-9


def test_a_lag_shorter_than_a_block_is_found():
    """Of a long window, in which two or three points make a block: the lag is not taken for dead time."""
    plant = Plant("integrating", 0.01, 9.0, (2.5,))
    window = window_of(plant, replace(simc(plant, 1.0), kp=simc(plant, 1.0).kp / 3), 900.0)
    fit = fit_window(window, INTEGRATING)
    assert fit is not None
    assert fit.lag == pytest.approx(2.5, abs=0.1)
    assert fit.dead_time == pytest.approx(9.0, abs=0.1)


def test_a_lost_sample_widens_the_intervals():
    """The row of the derivative's kick is lost: the gain is wrong by a tenth, and its interval says so."""
    plant = Plant("integrating", 0.05, 4.0, (3.0,))
    controller = replace(simc(plant, 1.0), kp=0.5 * simc(plant, 1.0).kp, td=6.0, tf=0.6)
    window = window_of(plant, controller, 300.0, 0.002)
    whole = fit_window(window, INTEGRATING)
    fits = [fit_window(without_point(window, BEFORE + k), INTEGRATING) for k in (1, 2, 150)]
    assert whole is not None
    for fit in fits:
        assert fit is not None
        low, high = fit.interval("gain")
        assert low <= plant.gain <= high
    assert fits[0] is not None
    assert fits[2] is not None
    assert fits[0].scatter[0, 0] > 20 * whole.scatter[0, 0]
    assert fits[2].scatter[0, 0] < 4 * whole.scatter[0, 0]  # nothing but noise moved there


@pytest.mark.parametrize("process", [INTEGRATING, SELF_REGULATING])
@pytest.mark.parametrize(
    "window",
    [
        np.zeros((0, 4)),
        np.zeros((5, 4)),
        np.column_stack([np.arange(50.0), np.zeros(50), np.zeros(50), np.ones(50)]),
        np.column_stack([np.arange(50.0), np.zeros(50), np.zeros(50), np.arange(50) > 20]),
        np.column_stack([np.arange(50.0), np.zeros(50), np.arange(50.0), np.full(50, 3.0)]),
    ],
    ids=["empty", "short", "dead", "PV rests", "OP rests"],
)
def test_nothing_moved_is_no_model(process, window):
    """None instead of a figure where OP or PV did not move, or there is too little."""
    assert fit_window(EventWindow(*window.T, 20), process) is None


def test_a_positive_offset_and_slope_do_not_matter():
    """A level that is not 0 and a load that OP had not balanced leave the model alone."""
    plant = Plant("integrating", 0.05, 4.0, (3.0,))
    window = window_of(plant, simc(plant, 1.0), 300.0)
    plain = fit_window(window, INTEGRATING)
    drifting = window.pv + 500.0 + 1e-3 * window.time
    other = replace(window, sp=window.sp + 500.0, pv=drifting, op=window.op + 33.0)
    moved = fit_window(other, INTEGRATING)
    assert plain is not None
    assert moved is not None
    for name in ("gain", "lag", "dead_time"):
        assert getattr(moved, name) == pytest.approx(getattr(plain, name), rel=1e-3), name


@settings(max_examples=15, deadline=None)
@given(a=st.floats(1e-3, 1e3), c=st.floats(1e-3, 1e3), seed=st.integers(0, 20))
def test_fit_scales_with_its_units(a, c, seed):
    """PV times a, OP times c: gain times a/c, times and quality unchanged."""
    plant = random_plant(np.random.default_rng(seed))
    window = window_of(plant, simc(plant, 1.0), 300.0, 0.01, seed)
    plain = fit_window(window, INTEGRATING)
    scaled = replace(window, sp=a * window.sp, pv=a * window.pv, op=c * window.op)
    other = fit_window(scaled, INTEGRATING)
    assert plain is not None
    assert other is not None
    assert other.gain == pytest.approx(plain.gain * a / c, rel=1e-5)
    assert other.t0 == pytest.approx(plain.t0, rel=1e-4)
    assert other.quality == pytest.approx(plain.quality, rel=1e-6)
    assert np.sqrt(other.cov[0, 0]) == pytest.approx(np.sqrt(plain.cov[0, 0]), rel=1e-3)


def test_model_response_follows_pv():
    """Offset and slope fitted, the model's PV lies within the noise of the measured one."""
    plant = Plant("integrating", 0.05, 4.0, (3.0,))
    window = window_of(plant, simc(plant, 1.0), 300.0, 0.01)
    fit = fit_window(window, INTEGRATING)
    assert fit is not None
    rest = window.pv - model_response(window, fit)
    assert np.std(rest) == pytest.approx(0.01, rel=0.2)
    assert abs(np.mean(rest)) < 1e-9


def test_more_noise_widens_the_intervals():
    """Honest: three times the noise, about three times the scatter."""
    plant = Plant("integrating", 0.05, 4.0, (3.0,))
    scatter = []
    for noise in (0.01, 0.03):
        fit = fit_window(window_of(plant, simc(plant, 1.0), 300.0, noise, 5), INTEGRATING)
        assert fit is not None
        scatter.append(math.sqrt(fit.scatter[0, 0]))
    assert scatter[1] == pytest.approx(3 * scatter[0], rel=0.5)


def test_correlation_time():
    """1 for white noise, (1 + a)/(1 - a) for a first-order process, never more than an eighth of the data."""
    rng = np.random.default_rng(0)
    white = rng.normal(size=20_000)
    assert correlation_time(white) == pytest.approx(1.0, abs=0.15)
    coloured = np.zeros(20_000)
    for k in range(1, 20_000):
        coloured[k] = 0.8 * coloured[k - 1] + white[k]
    assert correlation_time(coloured) == pytest.approx(9.0, rel=0.15)
    assert correlation_time(np.zeros(100)) == 1.0
    assert correlation_time(np.ones(80)) == 10.0


# ---------------------------------------------------------------------------------------------------
# intervals, integrals, several events


def test_intervals_are_in_order_and_not_below_zero():
    """For either sign of gain low <= value <= high; times are cut at 0; T0 bounds its parts."""
    for gain in (0.05, -0.05):
        fit = make_fit(gain=gain, lag=0.1, dead_time=0.2, sd=(0.3, 5.0, 5.0))
        for name in ("gain", "lag", "dead_time", "t0"):
            low, high = fit.interval(name)
            assert low <= getattr(fit, name) <= high, name
            if name != "gain":
                assert low >= 0
        assert fit.interval("lag")[1] <= fit.interval("t0")[1]


def test_setpoint_integrals_of_nothing():
    """An OP that balances to zero gives no gain, not an error."""
    gain, t0 = setpoint_integrals(1.0, 0.0, 1.0, 1.0)
    assert math.isnan(gain)
    assert math.isnan(t0)


def test_combining_one_is_that_one():
    """One event: the fit itself."""
    fit = make_fit()
    assert combine([fit]) is fit


def test_combining_lies_between_and_is_sharper():
    """The information-weighted mean: nearer to the better known, sharper than each; the floor stays."""
    sharp, blunt = make_fit(gain=0.050, sd=(0.01, 0.1, 0.1)), make_fit(gain=0.056, sd=(0.1, 1.0, 1.0))
    joint = combine([sharp, blunt])
    assert 0.050 < joint.gain < 0.0515
    assert joint.scatter[0, 0] < min(sharp.cov[0, 0], blunt.cov[0, 0])
    np.testing.assert_allclose(joint.floor, sharp.floor)
    again = combine([blunt, sharp])
    assert again.gain == pytest.approx(joint.gain, rel=1e-12)


def test_combining_keeps_the_sign():
    """Negative gains stay negative."""
    assert combine([make_fit(gain=-0.05), make_fit(gain=-0.06)]).gain < 0


def test_combining_half_a_second_lag_counts_as_dead_time():
    """Two fits that differ only in how a rounding is split up between lags and dead time are one process."""
    sharp = make_fit(process=SELF_REGULATING, lag=20.0, dead_time=4.0, lag2=2.0)
    other = make_fit(process=SELF_REGULATING, lag=19.0, dead_time=3.0, lag2=4.0)
    joint = combine([sharp, other])
    assert joint.lag + joint.lag2 / 2 == pytest.approx(21.0)
    assert joint.dead_time + joint.lag2 / 2 == pytest.approx(5.0)
    assert joint.valley is None


def test_many_events_do_not_beat_the_mismatch():
    """However many events, the gain's standard deviation does not fall below the floor of 1 %."""
    joint = combine([make_fit() for _ in range(50)])
    assert math.sqrt(joint.cov[0, 0]) >= 0.01


def test_contradictory_events():
    """Gains that differ beyond chance and by more than a fifth, or in sign."""
    agree = [make_fit(gain=0.05), make_fit(gain=0.052)]
    assert not contradictory(agree, combine(agree))
    differ = [make_fit(gain=0.05), make_fit(gain=0.10)]
    assert contradictory(differ, combine(differ))
    vague = [make_fit(gain=0.05, sd=(0.3, 1, 1)), make_fit(gain=0.10, sd=(0.3, 1, 1))]
    assert not contradictory(vague, combine(vague))
    opposite = [make_fit(gain=0.05), make_fit(gain=-0.05)]
    assert contradictory(opposite, opposite[0])


def test_decide():
    """The better fit wins, beyond doubt only by a margin; alone it wins; of nothing nothing is said."""
    one, two = make_fit(log_likelihood=100.0), make_fit(process=SELF_REGULATING, log_likelihood=99.0)
    assert decide([], 100.0) == (None, False)
    assert decide([one], 100.0) == (one, True)
    assert decide([two, one], 100.0) == (one, False)
    assert decide([replace(two, log_likelihood=120.0), one], 100.0)[1]
    assert decide([replace(two, log_likelihood=97.0), one], 100.0) == (one, True)


def test_a_long_lag_is_no_reason_for_doubt():
    """Where a self-regulating process would be tuned as an integrating one, and explains no more, it is called that."""
    one = make_fit(log_likelihood=100.0)
    slow = make_fit(process=SELF_REGULATING, lag=40.0, log_likelihood=103.0)
    likelier = replace(slow, log_likelihood=107.0)
    assert decide([one, slow], 1e9) == (one, True)
    assert decide([one, replace(slow, lag=20.0)], 1e9)[1] is False
    assert decide([one, likelier], 1e9) == (likelier, True)


def test_likelihoods_are_compared_over_the_points_of_the_poorer_one():
    """Twice as many independent points of equal variance are no better fit."""
    one = replace(make_fit(log_likelihood=100.0), n_eff=50.0)
    two = replace(make_fit(process=SELF_REGULATING, log_likelihood=200.0), n_eff=100.0)
    assert decide([one, two], 1e9)[1] is False


def test_a_loop_that_is_thinned_is_still_identified():
    """A slow event that was halved in resolution twice gives the same model."""
    plant = Plant("integrating", 0.002, 60.0, (40.0,))
    controller = simc(plant, 1.0)
    spec = LoopSpec(
        name="L", plant=plant, controller=controller, setpoint=Steps((400.0,), (1.0,)), noise=0.005, seed=3
    )
    detector = Detector([Loop(name="L")])
    found = detector.run(samples_of(Simulation([spec]).advance(6000.0))) + detector.flush()
    window = next(e.window for e in found if isinstance(e, ClosedEvent))
    assert np.median(np.diff(window.time)) >= 2.0
    fit = fit_window(window, INTEGRATING)
    assert fit is not None
    assert fit.gain == pytest.approx(plant.gain, rel=0.03)
    assert fit.t0 == pytest.approx(plant.t0, rel=0.1)


def test_noise_free_pi_of_the_twin():
    """The tests' own little loop is what it says: gain 0.05, four samples of dead time."""
    sp = np.full(500, 50.0)
    sp[BEFORE:] += 4.0
    pv, op = pi_loop(sp)
    window = EventWindow(np.arange(500.0) - BEFORE, sp, pv, op, BEFORE)
    fit = fit_window(window, INTEGRATING)
    assert fit is not None
    assert fit.gain == pytest.approx(0.05, rel=1e-3)
    assert fit.t0 == pytest.approx(4.0, abs=0.1)
