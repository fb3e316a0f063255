"""What bad data may not do: missing, late, strange and coarse samples, clocks, rates and units that change."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from monitor.contract.loops import Loop
from monitor.contract.samples import Samples
from monitor.detect.constants import SET_BACK_SAMPLES
from monitor.detect.detector import Detector
from monitor.detect.event import BY_GAP, CAUSES, ClosedEvent
from monitor.identify.integrals import setpoint_integrals
from sim_plants.loops import Simulation
from sim_plants.scenarios import reference_loops
from sim_plants.specs import NEVER, Steps
from tests.support.detection import as_bytes, columns_of, detected, events_of, openings_of, steps_of
from tests.support.plants import SECOND, START, pi_loop, samples_of, stepped, times
from tests.support.samples import join


def state_without_counts(detector: Detector) -> bytes:
    state = detector.state.copy()
    state["counts"] = np.zeros((), state["counts"].dtype)
    for name in ("late_run", "late_at", "bad_run"):
        state["clock"][name] = 0
    return state.tobytes()


BAD = {
    "NaN in PV": ({"pv": np.nan}, "bad_value"),
    "NaN in OP": ({"op": np.nan}, "bad_value"),
    "inf": ({"pv": np.inf}, "bad_value"),
    "-inf": ({"op": -np.inf}, "bad_value"),
    "1e38": ({"pv": 1e38}, "bad_value"),
    "1e38 in OP": ({"op": 1e38}, "bad_value"),
    "far out of range": ({"pv": 2000.0}, "bad_value"),
    "bad quality, plausible value": ({"quality": 0}, "bad_quality"),
    "quality 63": ({"quality": 63}, "bad_quality"),
    "same time, same value": ({"time": 0, "sp": 0, "pv": 0, "op": 0}, "duplicate"),
    "same time, another value": ({"time": 0}, "conflict"),
    "an hour old": ({"time": -3600 * SECOND}, "late"),
}


@pytest.mark.parametrize("at", [100, 230], ids=["quiet", "in an event"])
@pytest.mark.parametrize("case", BAD)
def test_a_bad_sample_is_counted_and_changes_nothing(case, at):
    """Counted under its cause; all other state, and every event after it, as if it had not been there."""
    changes, cause = BAD[case]
    samples = stepped(700, noise=0.01)
    bad = samples.take([at])
    new = {}
    for name, value in changes.items():
        if name == "time":
            new[name] = samples.time[[at - 1]] + value
        elif value == 0 and name != "quality":
            new[name] = getattr(samples, name)[[at - 1]]
        else:
            new[name] = np.array([value], getattr(samples, name).dtype)
    bad = replace(bad, **new)
    loop = Loop(name="L", pv_low=0.0, pv_high=100.0)
    with_it, without = Detector([loop]), Detector([loop])
    head, tail = samples.take(slice(0, at)), samples.take(slice(at, None))
    found = with_it.run(join([head, bad]))
    expected = without.run(head)
    assert state_without_counts(with_it) == state_without_counts(without)
    assert with_it.state[0]["counts"][cause] == 1
    assert (
        sum(
            int(with_it.state[0]["counts"][n])
            for n in ("ok", "bad_value", "bad_quality", "duplicate", "late")
        )
        == at + 1
    )
    assert as_bytes(found + with_it.run(tail)) == as_bytes(expected + without.run(tail))


def test_an_uncertain_sample_is_used_and_counted():
    """Quality 64 to 191 counts as good data, and is counted apart."""
    samples = stepped(700)
    detector, found = detected(replace(samples, quality=np.full(700, 64, np.uint8)))
    assert [e.uncertain_share for e in events_of(found)] == [1.0]
    found = [replace(e, uncertain_share=0.0) if isinstance(e, ClosedEvent) else e for e in found]
    assert as_bytes(found) == as_bytes(detected(samples)[1])
    assert detector.state[0]["counts"]["uncertain"] == detector.state[0]["counts"]["ok"] == 700


def test_nothing_but_bad_samples_is_no_event():
    """No good sample: nothing seen, nothing found, all counted."""
    n = 500
    detector, found = detected(Samples.of(0, times(n), 50.0, np.nan, 20.0))
    assert steps_of(found) == []
    assert detector.state[0]["counts"]["ok"] == 0
    assert detector.state[0]["counts"]["bad_value"] == n


def test_subnormal_and_negative_zero_are_values():
    """-0.0 and 5e-324 do no harm."""
    n = 400
    pv = np.where(np.arange(n) % 2, -0.0, 5e-324)
    detector, found = detected(Samples.of(0, times(n), 0.0, pv, 0.0))
    assert steps_of(found) == []
    assert detector.state[0]["counts"]["ok"] == n
    assert np.isfinite(detector.state[0]["noise"]["now"]["var_e"])


@pytest.mark.parametrize("size", [20.0, -20.0, 1000.0])
def test_a_spike_is_nothing_and_does_not_inflate_the_noise(size):
    """One sample of twenty standard deviations, or a thousand: no step, no load, the noise stays what it was."""
    rng = np.random.default_rng(5)
    pv = 50 + rng.normal(0, 0.1, 2000)
    spiked = pv.copy()
    spiked[1500] += 0.1 * size
    clean, _ = detected(Samples.of(0, times(2000), 50.0, pv, 20.0))
    detector, found = detected(Samples.of(0, times(2000), 50.0, spiked, 20.0))
    assert found == []
    assert detector.state[0]["event"]["number"] == 0
    noise, expected = detector.state[0]["noise"], clean.state[0]["noise"]
    assert noise["var_d"] == pytest.approx(expected["var_d"], rel=0.1)
    for name in ("var_e", "var_s"):
        assert noise["now"][name] == pytest.approx(expected["now"][name], rel=0.1)


def test_a_set_point_that_is_missing_holds():
    """NaN in SP: PV and OP go on being used, under the last set point; the sample counts as uncertain."""
    samples = stepped(700, noise=0.01)
    sp = samples.sp.copy()
    sp[[100, 150, 230, 231]] = np.nan
    detector, found = detected(replace(samples, sp=sp))
    expected = detected(samples)[1]
    (event,), (whole,) = events_of(found), events_of(expected)
    np.testing.assert_array_equal(columns_of(event.window), columns_of(whole.window))
    assert event.iae == whole.iae
    assert detector.state[0]["counts"]["ok"] == 700


def test_a_set_point_that_changes_unseen_is_no_step():
    """SP missing for a minute, and another one after: nobody knows when it moved. The next step is found."""
    samples = stepped(1500, 700, noise=0.01)
    sp, pv = samples.sp + 1.0 * (np.arange(1500) > 330), samples.pv + 1.0 * (np.arange(1500) > 330)
    sp[300:360] = np.nan
    _, found = detected(replace(samples, sp=sp, pv=pv))
    assert [e.onset for e in events_of(found)] == [START + 700 * SECOND]


def test_a_clock_that_is_set_back_costs_some_samples_not_an_hour():
    """From the 21st late sample in a row on the loop goes on, after a gap; a step soon after is found."""
    samples = stepped(1200, 600, noise=0.01)
    shifted = samples.time.copy()
    shifted[300:] -= 3600 * SECOND
    detector, found = detected(replace(samples, time=shifted), period=1.0)
    state = detector.state[0]
    counts = (state["counts"]["late"], state["clock"]["set_back"], state["counts"]["ok"])
    assert counts == (SET_BACK_SAMPLES, 1, 1200 - SET_BACK_SAMPLES)
    assert [e.onset for e in events_of(found)] == [shifted[600]]
    assert detector.health[0]["coverage"]["wall_time"] == pytest.approx(1200, abs=SET_BACK_SAMPLES + 2)


def test_a_clock_that_is_set_back_interrupts_an_event():
    """The open event ends at its last sample before, by a gap; its integrals stay finite and small."""
    samples = stepped(700, 200, noise=0.01)
    shifted = samples.time.copy()
    shifted[230:] -= 3600 * SECOND
    _, found = detected(replace(samples, time=shifted), period=1.0)
    (event,) = events_of(found)
    assert (event.state, event.cause) == ("interrupted", CAUSES[BY_GAP])
    assert event.end == START + 229 * SECOND


def test_a_batch_of_old_samples_is_dropped():
    """Twenty replayed samples among the live ones never take the loop back."""
    samples = stepped(700, 200, noise=0.01)
    old = samples.take(slice(100, 100 + SET_BACK_SAMPLES))
    parts = [
        samples.take(slice(0, 230)),
        old,
        samples.take(slice(230, 231)),
        old,
        samples.take(slice(231, None)),
    ]
    detector, found = detected(join(parts), period=1.0)
    assert as_bytes(found) == as_bytes(detected(samples, period=1.0)[1])
    assert detector.state[0]["counts"]["late"] == 2 * SET_BACK_SAMPLES
    assert detector.state[0]["clock"]["set_back"] == 0


@pytest.mark.parametrize("facts", [{}, {"period": 1.0}], ids=["period measured", "period given"])
def test_a_sample_rate_that_changes_is_followed(facts):
    """1 s, then 10 s, then 1 s again: no event by it; a step is found at either rate."""
    sp = np.full(1500, 50.0)
    sp[300:] += 4.0
    sp[1200:] -= 4.0
    pv, op = pi_loop(sp, gain=0.01, kp=1.0, ti=200.0, noise=0.02)
    dt = np.where((np.arange(1500) >= 600) & (np.arange(1500) < 900), 10, 1)
    samples = Samples.of(0, START + np.cumsum(dt) * SECOND, sp, pv, op)
    detector = Detector([Loop(name="L", **facts)])
    found = detector.run(samples.take(slice(0, 850)))
    assert detector.state[0]["clock"]["period"] == pytest.approx(10.0)
    found += detector.run(samples.take(slice(850, None)))
    assert detector.state[0]["clock"]["period"] == pytest.approx(1.0)
    assert [e.onset for e in openings_of(found)] == [samples.time[300], samples.time[1200]]


@pytest.mark.parametrize("kind", ["jittered", "by exception", "5 % missing"])
def test_uneven_times_make_no_event(kind):
    """Periods of 0.8 to 1.2 s, values sent only when they change, samples missing: nothing is invented."""
    rng = np.random.default_rng(8)
    n = 20_000
    pv = 50 + rng.normal(0, 0.1, n)
    time = times(n)
    if kind == "jittered":
        time = time + rng.integers(-200_000_000, 200_000_000, n)
    keep = np.ones(n, bool)
    if kind == "5 % missing":
        keep = rng.random(n) > 0.05
    if kind == "by exception":
        keep = np.abs(np.diff(pv, prepend=0.0)) > 0.15
    _, found = detected(Samples.of(0, time, 50.0, pv, 30.0).take(keep))
    assert found == []


@pytest.mark.parametrize("in_event", [False, True])
def test_other_units_are_no_step(in_event):
    """degC becomes degF in SP and PV at once: no step, a new baseline; an open event ends there."""
    samples = stepped(1500, 200 if in_event else 900, noise=0.02, kp=0.5, ti=200.0)
    other = np.arange(1500) >= 240
    found = detected(
        replace(
            samples,
            sp=np.where(other, 1.8 * samples.sp + 32, samples.sp),
            pv=np.where(other, 1.8 * samples.pv + 32, samples.pv),
        )
    )[1]
    if in_event:
        assert [(e.state, e.cause) for e in events_of(found)] == [("interrupted", CAUSES[BY_GAP])]
    else:
        assert [e.amplitude for e in events_of(found)] == pytest.approx([1.8 * 4.0])


def test_one_missing_sample_is_bridged():
    """Its neighbours' interval is twice as long; the integrals hold; it does not count as covered."""
    samples = stepped(700)
    whole = events_of(detected(samples)[1])[0]
    keep = np.ones(700, bool)
    keep[[215, 231]] = False
    (event,) = events_of(detected(samples.take(keep))[1])
    assert event.state == "settled"
    assert event.iae == pytest.approx(whole.iae, rel=0.01)
    assert whole.good_time == pytest.approx(whole.duration)
    assert event.good_time == pytest.approx(event.duration - 1.0)


def test_five_percent_missing_at_random():
    """IAE within 1 %, no other event, coverage falls by about as much."""
    samples = stepped(2000, 800, noise=0.01, kp=0.3, ti=60.0)
    whole = events_of(detected(samples)[1])[0]
    keep = np.random.default_rng(2).random(2000) > 0.05
    keep[798:806] = True
    (event,) = events_of(detected(samples.take(keep))[1])
    signal = whole.iae - whole.iae_noise
    assert event.iae - event.iae_noise == pytest.approx(signal, rel=0.01)
    assert event.good_time / event.duration < 0.99


def test_jittered_times_do_not_bias_the_integrals():
    """Periods of 0.8 to 1.2 s: gain and T0 as with even ones."""
    rng = np.random.default_rng(3)
    spec = replace(reference_loops(0, 0.1)[0], setpoint=Steps((50.0,), (1.0,)), load=NEVER)
    block = samples_of(Simulation([spec]).advance(200.0))
    keep = np.cumsum(rng.integers(1, 4, 1200))
    uneven = block.take(keep[keep < len(block)])
    (event,) = events_of(detected(uneven, period=0.2)[1])
    gain, _ = setpoint_integrals(event.amplitude, event.s1, event.s2, event.y1)
    assert gain == pytest.approx(1.0, rel=0.05)


def test_time_at_a_limit_is_counted_only_where_limits_are_known():
    """OP at its limit within the event and over the loop's life; 0 and 100 are never assumed."""
    samples = stepped(700, kp=3.0, ti=200.0, dead=1)
    op = np.minimum(samples.op, 55.0)
    with_limit, found = detected(replace(samples, op=op), op_high=55.0, op_low=0.0)
    (event,) = events_of(found)
    at_limit = int((op >= 55.0).sum())
    assert at_limit > 0
    assert event.saturated_time == pytest.approx(at_limit, abs=1)
    assert with_limit.health[0]["saturation"]["limit_time"] == pytest.approx(at_limit, abs=1)
    without, _ = detected(replace(samples, op=np.clip(samples.op, 0, 100)))
    assert without.health[0]["saturation"]["limit_time"] == 0.0


@pytest.mark.parametrize("value", [-999.0, 1e5])
@pytest.mark.parametrize("at", [7, 12, 18])
def test_a_glitch_at_the_start_does_not_pass_for_noise(value, at):
    """One wild sample of good quality while the baseline is learnt: the step that comes later is found."""
    samples = stepped(1200, at=600, size=2.0, noise=0.05)
    pv = samples.pv.copy()
    pv[at] = value
    _, found = detected(replace(samples, pv=pv))
    assert [e.amplitude for e in events_of(found)] == [2.0]
