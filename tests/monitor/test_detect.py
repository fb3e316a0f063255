"""The streaming kernel: what opens and closes an event, its integrals and window, and what bad data may not do."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from twin import SECOND, START, integrals, pi_loop, samples_of, times

from monitor.detect import Detector
from monitor.identify import fit_window, load_integrals, setpoint_integrals
from monitor.loops import Loop
from monitor.samples import Samples, join
from monitor.state import (
    BY_END,
    BY_GAP,
    BY_MODE,
    BY_STEP,
    CLOSED,
    COUNTS,
    OPENED,
    RING,
    STATES,
    WINDOW,
)
from sim_plants.fleet import random_fleet
from sim_plants.loops import Simulation
from sim_plants.scenarios import reference_loops
from sim_plants.specs import NEVER, Steps

Found = list[tuple[Any, NDArray[np.float64]]]

# Unit steps; mu, T0, half rule's theta, IAE of the set-point step, IAE of the load step.
REFERENCE = {
    "REF-1": (1.0, 1.0, 1.0, 3.922, 16.0),
    "REF-2": (1.0, 2.0, 0.5, 2.272, 4.0),
    "REF-3": (0.2, 8.0, 3.5, 33.98, 320.0),
    "REF-4": (0.2, 8.0, 3.5, 17.64, 50.0),
}
FINE = 0.01
"""[s] Backward differences err by about a period over the filter time."""


def is_step(event: Any) -> bool:
    """Whether it is a set-point step's; the kernel also hands out what may be a load step, to be verified."""
    return "kind" not in event.dtype.names or event["kind"] == 0


def events_of(found: Found, what: int = CLOSED) -> list[Any]:
    return [event for event, _ in found if event["what"] == what and is_step(event)]


def steps_of(found: Found) -> list[Any]:
    """Set-point events, opened or closed."""
    return events_of(found, OPENED) + events_of(found)


def closings(found: Found) -> Found:
    """Set-point events with their windows."""
    return [(event, window) for event, window in found if event["what"] == CLOSED and is_step(event)]


def as_bytes(found: Found) -> list[tuple[bytes, bytes]]:
    """Everything an event says but the slot its window happened to lie in."""
    out = []
    for event, window in found:
        copy = event.copy()
        copy["slot"] = copy["loop_state"]["slot"] = 0
        for name in COUNTS:
            copy["loop_state"][name] = 0
        out.append((copy.tobytes(), window.tobytes()))
    return out


def stepped(n: int = 700, at: int = 200, size: float = 4.0, **facts: Any) -> Samples:
    """One loop with a set-point step, at rest before it."""
    sp = np.full(n, 50.0)
    sp[at:] += size
    pv, op = pi_loop(sp, **facts)
    return Samples.of(0, times(n), sp, pv, op)


def detected(samples: Samples, **facts: Any) -> tuple[Detector, Found]:
    detector = Detector([Loop(name="L", **facts)])
    found = detector.run(samples)
    return detector, found + detector.flush()


def slots_are_whole(detector: Detector) -> None:
    """Each slot of the slab is either free, once, or held by one loop."""
    free = detector.free[: detector.n_free[0]]
    held = detector.state["slot"][detector.state["slot"] >= 0]
    together = np.sort(np.concatenate([free, held]))
    np.testing.assert_array_equal(together, np.arange(len(detector.slab)))


# ---------------------------------------------------------------------------------------------------
# the reference loops of the literature


@pytest.fixture(scope="module")
def reference() -> dict[str, tuple[Any, NDArray[np.float64]]]:
    """The set-point event of each reference loop, noise-free, in fine time."""
    found = {}
    for loop in reference_loops(0, FINE):
        spec = replace(loop, setpoint=Steps((20.0,), (1.0,)), load=NEVER)
        block = Simulation([spec]).advance(1500.0 if spec.name == "REF-3" else 700.0)
        detector = Detector([Loop(name=spec.name, period=0.2)])
        closed = closings(detector.run(samples_of(block)))
        assert len(closed) == 1
        found[spec.name] = closed[0]
    return found


@pytest.mark.parametrize("name", REFERENCE)
def test_integrals_give_gain_and_t0_of_the_reference_loops(reference, name):
    """mu within 0.1 %, T0 within 1 %, from the running integrals of a set-point step alone."""
    event, _ = reference[name]
    gain, t0 = setpoint_integrals(*(float(event[n]) for n in ("amplitude", "s1", "s2", "y1")))
    assert STATES[event["state"]] == "settled"
    assert gain == pytest.approx(REFERENCE[name][0], rel=1e-3)
    assert t0 == pytest.approx(REFERENCE[name][1], rel=0.01)


@pytest.mark.parametrize("name", REFERENCE)
def test_iae_of_the_reference_loops(reference, name):
    """IAE within 1 % of the published figure, and none of it taken for noise but the settled tail."""
    event, _ = reference[name]
    assert event["iae"] == pytest.approx(REFERENCE[name][3], rel=0.01)
    assert event["iae_noise"] == pytest.approx(0.0, abs=1e-6 * event["iae"])


@pytest.mark.parametrize("name", REFERENCE)
def test_fit_gives_the_half_rules_dead_time_of_the_reference_loops(name):
    """The fit's effective dead time lies within 15 % of the half rule's, gain within 1 %, T0 within 10 %."""
    gain, t0, dead_time, *_ = REFERENCE[name]
    (spec,) = (s for s in reference_loops(0, 0.05) if s.name == name)
    spec = replace(spec, setpoint=Steps((20.0,), (1.0,)), load=NEVER)
    _, found = detected(samples_of(Simulation([spec]).advance(520.0)))
    ((event, window),) = closings(found)
    fit = fit_window(window, int(event["before"]), "integrating")
    assert fit is not None
    assert fit.dead_time == pytest.approx(dead_time, rel=0.15)
    assert fit.gain == pytest.approx(gain, rel=0.01)
    assert fit.t0 == pytest.approx(t0, rel=0.1)  # the long tail has cost the window its resolution


@pytest.mark.parametrize("name", ["REF-1", "REF-2", "REF-4"])
def test_load_integrals_give_size_onset_and_gain(name):
    """A load step's size, its onset (which is not measured) and the gain follow from the integrals."""
    (spec,) = (s for s in reference_loops(0, FINE) if s.name == name)
    onset, end = 30.0, 530.0
    spec = replace(spec, setpoint=NEVER, load=Steps((onset,), (1.0,)))
    block = Simulation([spec]).advance(end + FINE)
    window = np.column_stack([(block.time_ns - block.time_ns[0]) * 1e-9, block.sp, block.pv, block.op])
    found = integrals(window, 0.0, 0.0)
    u_end = float(block.op[-1])
    size, age, gain, _ = load_integrals(*(found[n] for n in ("s1", "s2", "s3", "y1", "y2")), u_end)
    assert size == pytest.approx(1.0, rel=1e-3)
    assert window[-1, 0] - age == pytest.approx(onset, abs=0.02)
    assert gain == pytest.approx(REFERENCE[name][0], rel=1e-3)
    assert found["iae"] == pytest.approx(REFERENCE[name][4], rel=0.01)


def test_running_integrals_equal_their_naive_twin():
    """All integrals, on uneven times, equal the textbook sums over the event's samples."""
    samples = stepped(noise=0.05, seed=3)
    jitter = np.random.default_rng(1).integers(-200_000_000, 200_000_000, len(samples))
    samples = replace(samples, time=samples.time + jitter)
    _, found = detected(samples, period=1.0)
    ((event, window),) = closings(found)
    after = window[event["before"] - 1 :]
    naive = integrals(after, event["pv0"], event["op0"])
    # the integrals begin at the onset; OP still held its old value on the way to it
    between = naive | {"s1": naive["s1"] - (after[0, 3] - event["op0"]) * -after[0, 0]}
    whole = integrals(window[event["before"] :], event["pv0"], event["op0"])
    assert len(between) == len(whole)
    for name, value in whole.items():
        assert event[name] == pytest.approx(value, rel=1e-9), name


# ---------------------------------------------------------------------------------------------------
# what is a step, and what is not


def test_a_step_opens_and_closes_one_event():
    """One opening, one closing, of the step's size, at the sample that shows it, with what came before."""
    _, found = detected(stepped())
    (opened,), (closed,) = events_of(found, OPENED), events_of(found)
    for event in (opened, closed):
        assert event["amplitude"] == pytest.approx(4.0)
        assert event["onset"] == START + 200 * SECOND
        assert event["number"] == 1
    assert STATES[closed["state"]] == "settled"
    assert closed["quiet"] == 1.0
    window = found[-1][1]
    assert window[closed["before"], 0] == 0.0
    assert closed["before"] == RING


def test_a_set_point_smeared_over_three_samples_is_one_step():
    """A historian's interpolation makes several small moves of one step."""
    sp = np.full(700, 50.0)
    sp[200:] = 54.0
    sp[200], sp[201] = 51.1, 52.9
    pv, op = pi_loop(sp)
    _, found = detected(Samples.of(0, times(700), sp, pv, op))
    (closed,) = events_of(found)
    assert closed["amplitude"] == pytest.approx(4.0)
    assert closed["onset"] == START + 200 * SECOND


@pytest.mark.parametrize("moves", [8, 100, 500])
def test_a_ramp_is_no_step(moves):
    """A set point that keeps moving opens nothing, and its window is given back."""
    sp = np.full(900, 50.0)
    sp[200 : 200 + moves] += np.linspace(0, 4, moves)
    sp[200 + moves :] += 4.0
    pv, op = pi_loop(sp, noise=0.02)
    detector, found = detected(Samples.of(0, times(900), sp, pv, op))
    assert steps_of(found) == []
    slots_are_whole(detector)


def test_a_set_point_that_never_rests_is_no_step():
    """A cascade slave's set point, moving at every sample, opens nothing."""
    rng = np.random.default_rng(0)
    sp = 50 + np.cumsum(rng.normal(0, 0.1, 3000))
    detector, found = detected(Samples.of(0, times(3000), sp, sp + rng.normal(0, 0.01, 3000), 50.0))
    assert steps_of(found) == []
    slots_are_whole(detector)


def test_a_staircase_of_held_steps_is_one_event_a_step():
    """Each tread that is held long enough cuts the event before it short and opens its own."""
    sp = np.full(700, 50.0)
    for k in range(3):
        sp[200 + 30 * k :] += 2.0
    pv, op = pi_loop(sp)
    _, found = detected(Samples.of(0, times(700), sp, pv, op))
    closed = events_of(found)
    assert [STATES[e["state"]] for e in closed] == ["interrupted", "interrupted", "settled"]
    assert [int(e["cause"]) for e in closed[:2]] == [BY_STEP, BY_STEP]
    assert [e["amplitude"] for e in closed] == pytest.approx([2.0, 2.0, 2.0])
    assert [e["quiet"] for e in closed] == [1.0, 0.0, 0.0]


def test_a_step_below_the_noise_is_none():
    """Half a standard deviation of the error cannot be told from noise."""
    detector, found = detected(stepped(1500, 500, 0.25, noise=0.5))
    assert steps_of(found) == []
    slots_are_whole(detector)


def test_a_step_that_is_taken_back_at_once_is_none():
    """Two samples of another set point are a typing mistake."""
    sp = np.full(700, 50.0)
    sp[200:202] = 60.0
    pv, op = pi_loop(sp)
    detector, found = detected(Samples.of(0, times(700), sp, pv, op))
    assert steps_of(found) == []
    slots_are_whole(detector)


@pytest.mark.parametrize("colour", [0.0, 0.9, 0.99])
def test_noise_alone_opens_nothing(colour):
    """Fifty loops of white or coloured noise, a million samples: no event, and the noise is measured."""
    loops, n = 50, 20_000
    rng = np.random.default_rng(7)
    white = rng.normal(size=(n, loops))
    e = np.zeros((n, loops))
    for k in range(1, n):
        e[k] = colour * e[k - 1] + np.sqrt(1 - colour**2) * white[k]
    detector = Detector([Loop(name=str(k)) for k in range(loops)])
    loop = np.tile(np.arange(loops, dtype=np.int32), n)
    time = np.repeat(times(n), loops)
    found = detector.run(Samples.of(loop, time, 50.0, 50.0 + e.ravel(), 30.0 - e.ravel()))
    assert steps_of(found) == []
    if colour == 0.0:
        assert np.sqrt(detector.state["var_d"] / 6) == pytest.approx(np.ones(loops), rel=0.2)


def test_constant_signals_are_no_trouble():
    """No variance at the start: no division, no event; a step out of perfect rest is found."""
    n = 300
    sp = np.full(n, 10.0)
    sp[100:] = 11.0
    with np.errstate(all="raise"):
        detector, found = detected(Samples.of(0, times(n), sp, 10.0, 5.0))
    assert [e["amplitude"] for e in events_of(found)] == [1.0]
    for name in detector.state.dtype.names:
        assert np.isfinite(detector.state[name]).all(), name


def test_a_slow_process_is_waited_for():
    """A dead time of 150 samples, or a tail of many minutes, is no end of an event."""
    slow = stepped(3000, 200, kp=0.04, ti=2000.0, dead=150, noise=0.04)
    _, found = detected(slow)
    (closed,) = events_of(found)
    after = (closed["end"] - closed["onset"]) / SECOND
    assert after > 600
    assert abs(closed["offset"]) < 0.15 * closed["amplitude"]


def test_an_event_of_a_loop_that_never_follows_ends():
    """Where PV does not move at all the event ends after some hundred samples, away from the set point."""
    n = 2000
    sp = np.full(n, 10.0)
    sp[100:] = 11.0
    _, found = detected(Samples.of(0, times(n), sp, 10.0, 5.0))
    (closed,) = events_of(found)
    assert STATES[closed["state"]] == "settled"
    assert closed["offset"] == pytest.approx(1.0)
    assert closed["end"] < START + 1000 * SECOND


def test_a_loop_that_does_not_settle_is_given_up():
    """An undamped oscillation after the step: `timeout`, with everything there is in the window."""
    n = 12_000
    k = np.arange(n)
    sp = np.full(n, 50.0)
    sp[500:] = 54.0
    pv = np.where(k < 500, 50.0, 54.0 + 3 * np.sin(k / 20.0))
    _, found = detected(Samples.of(0, times(n), sp, pv, 50.0 + 0.2 * (sp - pv)))
    (closed,) = events_of(found)
    assert STATES[closed["state"]] == "timeout"
    assert 9_000 < (closed["end"] - closed["onset"]) / SECOND < 11_000


# ---------------------------------------------------------------------------------------------------
# what cuts an event short


def test_a_step_during_an_event_interrupts_it_and_opens_the_next():
    """The first ends where the second begins; the second is not from rest."""
    samples = stepped()
    sp = samples.sp.copy()
    sp[230:] += 3.0
    pv, op = pi_loop(sp)
    _, found = detected(replace(samples, sp=sp, pv=pv, op=op))
    first, second = events_of(found)
    assert (STATES[first["state"]], first["cause"]) == ("interrupted", BY_STEP)
    assert first["end"] == second["onset"] == START + 230 * SECOND
    assert second["amplitude"] == pytest.approx(3.0)


def test_a_gap_interrupts_an_event_and_nothing_is_integrated_across():
    """An hour without data in the middle of an event: closed at the last sample before it."""
    samples = stepped()
    shifted = samples.time.copy()
    shifted[260:] += 3600 * SECOND
    detector, found = detected(replace(samples, time=shifted))
    (closed,) = events_of(found)
    assert (STATES[closed["state"]], closed["cause"]) == ("interrupted", BY_GAP)
    assert closed["end"] == START + 259 * SECOND
    assert closed["iae"] < 4.0 * 60
    health = detector.health[0]
    assert health["wall_time"] == pytest.approx(699 + 3600)
    assert health["good_time"] < 700


def test_manual_interrupts_an_event_and_counts():
    """A change to manual closes the event; nothing opens in manual; the share of time is kept."""
    samples = stepped()
    sp = samples.sp.copy()
    sp[400:] += 5.0
    auto = np.ones(700, bool)
    auto[260:500] = False
    detector, found = detected(replace(samples, sp=sp, auto=auto))
    (closed,) = events_of(found)
    assert (STATES[closed["state"]], closed["cause"]) == ("interrupted", BY_MODE)
    assert detector.health[0]["manual_time"] == pytest.approx(240.0, abs=1.5)


def test_back_to_automatic_with_a_bump_is_no_step():
    """A set point that was moved in manual is where the next baseline begins."""
    n = 900
    sp = np.full(n, 50.0)
    sp[300:] = 55.0
    auto = np.ones(n, bool)
    auto[250:400] = False
    _, found = detected(Samples.of(0, times(n), sp, sp, 30.0, auto))
    assert steps_of(found) == []


def test_the_end_of_the_data_interrupts_an_event():
    """`flush` closes what is open, once."""
    detector = Detector([Loop(name="L")])
    detector.run(stepped().take(slice(0, 240)))
    (closed,) = events_of(detector.flush())
    assert (STATES[closed["state"]], closed["cause"]) == ("interrupted", BY_END)
    assert detector.flush() == []
    slots_are_whole(detector)


# ---------------------------------------------------------------------------------------------------
# bad data


def state_without_counts(detector: Detector) -> bytes:
    state = detector.state.copy()
    for name in COUNTS:
        state[name] = 0
    return state.tobytes()


BAD = {
    "NaN in PV": ({"pv": np.nan}, "bad_value"),
    "NaN in SP": ({"sp": np.nan}, "bad_value"),
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
    samples = stepped(noise=0.01)
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
    assert with_it.state[0][cause] == 1
    assert (
        sum(int(with_it.state[0][n]) for n in ("ok", "bad_value", "bad_quality", "duplicate", "late"))
        == at + 1
    )
    assert as_bytes(found + with_it.run(tail)) == as_bytes(expected + without.run(tail))


def test_an_uncertain_sample_is_used_and_counted():
    """Quality 64 to 191 counts as good data, and is counted apart."""
    samples = stepped()
    detector, found = detected(replace(samples, quality=np.full(700, 64, np.uint8)))
    assert as_bytes(found) == as_bytes(detected(samples)[1])
    assert detector.state[0]["uncertain"] == detector.state[0]["ok"] == 700


def test_nothing_but_bad_samples_is_no_event():
    """No good sample: nothing seen, nothing found, all counted."""
    n = 500
    detector, found = detected(Samples.of(0, times(n), 50.0, np.nan, 20.0))
    assert steps_of(found) == []
    assert detector.state[0]["seen"] == 0
    assert detector.state[0]["bad_value"] == n


def test_subnormal_and_negative_zero_are_values():
    """-0.0 and 5e-324 do no harm."""
    n = 400
    pv = np.where(np.arange(n) % 2, -0.0, 5e-324)
    detector, found = detected(Samples.of(0, times(n), 0.0, pv, 0.0))
    assert steps_of(found) == []
    assert detector.state[0]["ok"] == n
    assert np.isfinite(detector.state[0]["var_e"])


def test_a_spike_is_no_step_and_does_not_inflate_the_noise():
    """One sample of twenty standard deviations leaves the noise estimate where it was."""
    rng = np.random.default_rng(5)
    pv = 50 + rng.normal(0, 0.1, 2000)
    spiked = pv.copy()
    spiked[1500] += 2.0
    clean, _ = detected(Samples.of(0, times(2000), 50.0, pv, 20.0))
    detector, found = detected(Samples.of(0, times(2000), 50.0, spiked, 20.0))
    assert steps_of(found) == []
    for name in ("var_e", "var_d"):
        assert detector.state[0][name] == pytest.approx(clean.state[0][name], rel=0.1)


def test_one_missing_sample_is_bridged():
    """Its neighbours' interval is twice as long; the integrals hold; it does not count as covered."""
    samples = stepped()
    whole = events_of(detected(samples)[1])[0]
    keep = np.ones(700, bool)
    keep[[215, 231]] = False
    (event,) = events_of(detected(samples.take(keep))[1])
    assert STATES[event["state"]] == "settled"
    assert event["iae"] == pytest.approx(whole["iae"], rel=0.01)
    assert whole["good"] == pytest.approx(whole["wall"])
    assert event["good"] == pytest.approx(event["wall"] - 1.0)


def test_five_percent_missing_at_random():
    """IAE within 1 %, no other event, coverage falls by about as much."""
    samples = stepped(2000, 800, noise=0.01, kp=0.3, ti=60.0)
    whole = events_of(detected(samples)[1])[0]
    keep = np.random.default_rng(2).random(2000) > 0.05
    keep[798:806] = True
    (event,) = events_of(detected(samples.take(keep))[1])
    signal = whole["iae"] - whole["iae_noise"]
    assert event["iae"] - event["iae_noise"] == pytest.approx(signal, rel=0.01)
    assert event["good"] / event["wall"] < 0.99


def test_jittered_times_do_not_bias_the_integrals():
    """Periods of 0.8 to 1.2 s: gain and T0 as with even ones."""
    rng = np.random.default_rng(3)
    spec = replace(reference_loops(0, 0.1)[0], setpoint=Steps((50.0,), (1.0,)), load=NEVER)
    block = samples_of(Simulation([spec]).advance(200.0))
    keep = np.cumsum(rng.integers(1, 4, 1200))
    uneven = block.take(keep[keep < len(block)])
    (event,) = events_of(detected(uneven, period=0.2)[1])
    gain, _ = setpoint_integrals(*(float(event[n]) for n in ("amplitude", "s1", "s2", "y1")))
    assert gain == pytest.approx(1.0, rel=0.05)


def test_time_at_a_limit_is_counted_only_where_limits_are_known():
    """OP at its limit within the event and over the loop's life; 0 and 100 are never assumed."""
    samples = stepped(kp=3.0, ti=200.0, dead=1)
    op = np.minimum(samples.op, 55.0)
    with_limit, found = detected(replace(samples, op=op), op_high=55.0, op_low=0.0)
    (event,) = events_of(found)
    at_limit = int((op >= 55.0).sum())
    assert at_limit > 0
    assert event["saturated"] == pytest.approx(at_limit, abs=1)
    assert with_limit.health[0]["limit_time"] == pytest.approx(at_limit, abs=1)
    without, _ = detected(replace(samples, op=np.clip(samples.op, 0, 100)))
    assert without.health[0]["limit_time"] == 0.0


# ---------------------------------------------------------------------------------------------------
# stream and batch, scale and shift


@pytest.fixture(scope="module")
def fleet() -> tuple[list[Loop], Samples]:
    """Twelve loops of several periods over 2,000 s, interleaved in time, some samples bad."""
    specs = random_fleet(12, 3, noise=(0.0, 0.02))
    samples = samples_of(Simulation(specs).advance(2000.0))
    rng = np.random.default_rng(0)
    pv = samples.pv.copy()
    pv[rng.random(len(pv)) < 0.01] = np.nan
    auto = samples.auto.copy()
    auto[(samples.loop == 3) & (np.arange(len(pv)) % 5000 < 40)] = False
    return [Loop(name=s.name) for s in specs], replace(samples, pv=pv, auto=auto)


@settings(max_examples=30, deadline=None)
@given(cuts=st.lists(st.integers(0, 20_000), max_size=30))
def test_any_batching_gives_the_same_events(fleet, cuts):
    """Bit-equal events and windows, and at every cut exactly those that a single batch had found by then."""
    loops, samples = fleet
    once = Detector(loops)
    whole = as_bytes(once.run(samples))
    assert len(whole) > 20
    detector, found = Detector(loops), []
    bounds = [0, *sorted(min(c, len(samples)) for c in cuts), len(samples)]
    for a, b in pairwise(bounds):
        found += as_bytes(detector.run(samples.take(slice(a, b))))
        assert found == whole[: len(found)]
        slots_are_whole(detector)
    assert found == whole
    slots = once.state["slot"] >= 0
    np.testing.assert_array_equal(slots, detector.state["slot"] >= 0)


def test_sample_by_sample_equals_one_batch(fleet):
    """The same, one sample a call."""
    loops, samples = fleet
    samples = samples.take(slice(0, 6000))
    whole = as_bytes(Detector(loops).run(samples))
    detector, found = Detector(loops), []
    for k in range(len(samples)):
        found += as_bytes(detector.run(samples.take(slice(k, k + 1))))
    assert found == whole
    assert whole


def test_loops_do_not_see_each_other(fleet):
    """Each loop alone, and all loops in another order of rows, give that loop's events bit by bit."""
    loops, samples = fleet
    whole = Detector(loops).run(samples)
    order = np.random.default_rng(4).permutation(len(loops))
    place = np.argsort(order).astype(np.int32)
    other = Detector([loops[k] for k in order]).run(replace(samples, loop=place[samples.loop]))
    for k, loop in enumerate(loops):
        rows = samples.take(samples.loop == k)
        alone = Detector([loop]).run(replace(rows, loop=np.zeros(len(rows), np.int32)))
        for found, row in ((whole, k), (other, place[k])):
            mine = []
            for event, window in found:
                if event["loop"] == row:
                    copy = event.copy()
                    copy["loop"] = 0
                    mine.append((copy, window))
            assert as_bytes(mine) == as_bytes(alone)


@settings(max_examples=25, deadline=None)
@given(
    a=st.floats(1e-3, 1e3),
    b=st.floats(-1e4, 1e4),
    c=st.floats(1e-3, 1e3),
    d=st.floats(-1e3, 1e3),
    shift=st.integers(-(10**18), 10**18),
)
def test_units_and_clock_do_not_matter(a, b, c, d, shift):
    """PV and SP in other units (a x + b), OP too, at another time: the same events, integrals scaled."""
    samples = stepped(noise=0.02, seed=9)
    other = replace(
        samples,
        sp=a * samples.sp + b,
        pv=a * samples.pv + b,
        op=c * samples.op + d,
        time=samples.time + shift,
    )
    (first,), (second,) = events_of(detected(samples)[1]), events_of(detected(other)[1])
    for name in ("onset", "end"):
        assert second[name] == first[name] + shift
    for name in ("state", "cause", "points", "before"):
        assert second[name] == first[name]
    assert second["amplitude"] == pytest.approx(a * first["amplitude"], rel=1e-6)
    assert second["iae"] == pytest.approx(a * first["iae"], rel=1e-6)
    assert second["noise"] == pytest.approx(a * first["noise"], rel=1e-5)
    assert second["s1"] == pytest.approx(c * first["s1"], rel=1e-5, abs=1e-7 * c)


# ---------------------------------------------------------------------------------------------------
# windows and slots


@settings(max_examples=20, deadline=None)
@given(n=st.integers(WINDOW + 200, 9000), seed=st.integers(0, 1000))
def test_thinning_keeps_the_integral_of_op(n, seed):
    """However often the window is halved, OP's integral over it is that of the samples, on uneven times."""
    rng = np.random.default_rng(seed)
    time = START + np.cumsum(rng.integers(500_000_000, 1_500_000_000, n))
    sp = np.full(n, 50.0)
    sp[100:] = 54.0
    op = rng.normal(50, 5, n)
    k = np.arange(n)
    pv = 50 + 0.3 * np.sin(k) + np.where(k > 100, 3 * np.sin(k / 20.0), 0.0)
    detector, found = detected(Samples.of(0, time, sp, pv, op), period=1.0)
    ((event, window),) = closings(found)
    t = (time - event["onset"]) * 1e-9
    first, last = np.searchsorted(t, window[0, 0] - 1e-6), np.searchsorted(t, window[-1, 0] - 1e-6)
    exact = float(np.sum(op[first:last] * np.diff(t)[first:last]))
    assert float(np.sum(window[:-1, 3] * np.diff(window[:, 0]))) == pytest.approx(exact, rel=1e-9)
    assert len(window) <= WINDOW
    assert np.median(np.diff(window[:, 0])) > 1.5  # halved at least once
    assert np.all(np.diff(window[:, 0]) > 0)
    assert window[event["before"], 0] >= 0 > window[event["before"] - 2, 0]
    # PV is picked, not averaged
    rows = np.searchsorted(t, window[:, 0] - 1e-6)
    np.testing.assert_array_equal(window[:, 2], pv[rows])
    slots_are_whole(detector)


def test_a_short_window_holds_every_sample():
    """The ring's samples from before the onset, then all until the end, as they came."""
    samples = stepped()
    _, found = detected(samples)
    ((event, window),) = closings(found)
    rows = slice(200 - RING, 200 - RING + len(window))
    for column, name in ((1, "sp"), (2, "pv"), (3, "op")):
        np.testing.assert_array_equal(window[:, column], getattr(samples, name)[rows])
    assert window[-1, 0] == pytest.approx((event["end"] - event["onset"]) / SECOND)


def test_an_upset_of_the_whole_plant():
    """Two thousand loops step at once, again and again: every event comes, slots return, the slab stops growing."""
    loops, n, rounds = 2000, 130, 3
    detector = Detector([Loop(name=str(k)) for k in range(loops)])
    sp = np.full(n, 50.0)
    sp[50:] = 54.0
    pv, op = pi_loop(sp)
    one = Samples.of(0, times(n), sp, pv, op)
    sizes = []
    for turn in range(rounds):
        start = turn * 100_000 * SECOND
        for a in range(0, n, 26):
            part = one.take(slice(a, a + 26))
            m = len(part)
            batch = Samples.of(
                np.tile(np.arange(loops), m),
                np.repeat(part.time + start, loops),
                *(np.repeat(getattr(part, name), loops) for name in ("sp", "pv", "op")),
            )
            found = detector.run(batch)
            slots_are_whole(detector)
            assert len({int(e["loop"]) for e in events_of(found, OPENED)}) == len(events_of(found, OPENED))
        closed = detector.flush()
        assert len(closed) == loops
        assert len({w.tobytes() for _, w in closed}) == 1
        assert detector.state["events"].tolist() == [turn + 1] * loops
        sizes.append(len(detector.slab))
    assert sizes == [sizes[0]] * rounds
    assert sizes[0] <= 2 * loops
    slots_are_whole(detector)


ACTS = ("step", "ramp", "gap", "manual", "spike", "rest", "blip", "bad")


@settings(max_examples=40, deadline=None)
@given(
    plan=st.lists(st.tuples(st.sampled_from(ACTS), st.integers(1, 60)), min_size=5, max_size=40),
    seed=st.integers(0, 99),
)
def test_no_slot_is_lost_or_shared_whatever_happens(plan, seed):
    """Steps, ramps, gaps, manual, spikes at random on forty loops: slots stay whole, events are well formed."""
    loops = 40
    detector = Detector([Loop(name=str(k), period=1.0) for k in range(loops)])
    reported: dict[int, int] = {}
    for batch in eventful(plan, loops, seed):
        take_note(detector.run(batch), reported)
        slots_are_whole(detector)
    take_note(detector.flush(), reported)
    assert reported == {}
    assert np.all(detector.state["slot"] == -1)
    slots_are_whole(detector)


def eventful(plan: list[tuple[str, int]], loops: int, seed: int) -> Iterator[Samples]:
    """Loops to which things happen; one sample of each a batch."""
    rng = np.random.default_rng(seed)
    sp, now = np.full(loops, 50.0), START
    for act, count in [("rest", 60), *plan]:
        struck = rng.random(loops) < 0.6
        moves = {"step": rng.normal(0, 5, loops), "blip": np.full(loops, 7.0)}.get(act, np.zeros(loops))
        for k in range(count):
            now += (101 if act == "gap" and k == 0 else 1) * SECOND
            sp = sp + struck * (moves if k == 0 else 0.0)
            sp = sp - struck * (moves if act == "blip" and k == 2 else 0.0)
            sp = sp + struck * (0.1 if act == "ramp" else 0.0)
            pv = sp + rng.normal(0, 0.05, loops) + struck * (50.0 if act == "spike" and k == 0 else 0.0)
            pv = np.where(struck & (act == "bad"), np.nan, pv)
            auto = ~struck if act == "manual" else True
            yield Samples.of(np.arange(loops), np.full(loops, now), sp, pv, 100 - sp, auto)


def take_note(found: Found, reported: dict[int, int]) -> None:
    """Each opening is followed by its own closing; windows are finite and run forward in time."""
    for event, window in found:
        row = int(event["loop"])
        assert np.isfinite(window).all()
        assert np.all(np.diff(window[:, 0]) > 0)
        if not is_step(event):
            continue
        if event["what"] == OPENED:
            assert row not in reported
            reported[row] = int(event["onset"])
        else:
            assert reported.pop(row) == event["onset"]
            assert event["onset"] <= event["end"]


def test_loops_added_later_leave_the_others_alone():
    """A new row in mid-event: the old loop's event comes out as if nothing had been added."""
    samples = stepped(noise=0.01)
    alone = as_bytes(detected(samples)[1])
    detector = Detector([Loop(name="L")])
    found = detector.run(samples.take(slice(0, 230)))
    detector.add([Loop(name="M"), Loop(name="N")])
    found += detector.run(samples.take(slice(230, None)))
    assert as_bytes(found) == alone
    other = detector.run(replace(samples, loop=np.full(700, 2, np.int32)))
    assert len(events_of(other)) == 1


def test_the_period_is_measured_and_followed():
    """Without a nominal period it is the median step; a gateway that changes its rate is followed."""
    detector = Detector([Loop(name="L")])
    detector.run(Samples.of(0, times(200, 2.0), 50.0, 50.0, 20.0))
    assert detector.state[0]["period"] == 2.0
    detector.run(Samples.of(0, times(300, 5.0, START + 1000 * SECOND), 50.0, 50.0, 20.0))
    assert detector.state[0]["period"] == 5.0


@pytest.mark.parametrize("before", [90, 300, 1100, 1500, 4000, 4003])
def test_windows_of_suspected_load_steps_run_forward_in_time(before):
    """However far back the window reaches into the rings, its points are the samples', in order, none twice."""
    n = before + 400
    rng = np.random.default_rng(before)
    pv = 50 + rng.normal(0, 0.02, n)
    late = np.arange(n) - before
    pv = pv + np.where(late > 0, 3.0 * late / 20 * np.exp(-late / 40.0), 0.0)
    samples = Samples.of(0, times(n), 50.0, pv, 100 - pv)
    detector = Detector([Loop(name="L")])
    found = [f for f in detector.run(samples) + detector.flush() if f[0]["what"] == CLOSED]
    assert found
    for event, window in found:
        at = np.round(window[:, 0] + (event["onset"] - START) / SECOND).astype(int)
        assert np.all(np.diff(at) > 0)
        np.testing.assert_array_equal(window[:, 2], pv[at])
