"""Rows 9 to 11 and 29 to 49 of the bad-data matrix: signals that are not what they seem."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from monitor.contract.records import GOOD, INCONCLUSIVE, NOT_ASSESSED
from sim_plants.loops import Simulation
from sim_plants.troubles import troubles
from sim_plants.truth import loop_table
from tests.bad_data import harness
from tests.bad_data.harness import (
    NAME,
    SECOND,
    SETTINGS,
    START,
    Live,
    Outcome,
    audit,
    good,
    live,
    messages,
    same,
    simulated,
    steps,
)

N = 700


def both(
    data: pd.DataFrame, folder: Path, *, payloads: tuple[str, ...] = ("frame",), **facts: Any
) -> Outcome:
    """Run the data both ways; what a payload looks like is no matter of the signals in it."""
    return harness.both(data, folder, payloads=payloads, **facts)


def no_settings(found: Outcome) -> None:
    """Nothing is suggested, and nothing is called good."""
    assert found.row.verdict != GOOD
    assert found.row.new_kp is None


# ---------------------------------------------------------------------------------------------------
# PV that does not move


def frozen(n: int = 1800, since: int = 200) -> pd.DataFrame:
    """PV stands still at a value off the set point, while the controller winds OP up."""
    data = simulated(steps(n, (since + 100, 2.0)))
    pv = data["pv"].to_numpy().copy()
    pv[since:] = pv[since]
    e = data["sp"].to_numpy() - pv
    return data.assign(pv=pv, op=40.0 + 2.0 * e + 0.02 * np.cumsum(e))


def test_a_frozen_pv_while_the_output_moves(tmp_path: Path) -> None:
    """Exactly equal PVs for long while OP travels: a stuck sensor; no index, and never perfect control."""
    found = both(frozen(), tmp_path)
    assert "stuck_pv" in found.row.flags
    assert "idle" not in found.row.flags
    no_settings(found)


def test_a_long_dead_time_at_the_start_is_no_frozen_pv(tmp_path: Path) -> None:
    """Without noise PV has not moved at all when OP does, for 600 samples; one that never moves is frozen."""
    n, dead = 2000, 600
    data = simulated(steps(n, (50, 2.0)), noise=0.0, dead=dead, kp=0.2, ti=5000.0, gain=0.005)
    assert data["pv"].nunique() > 100
    assert (data["pv"][: 50 + dead] == 50.0).all()
    assert "stuck_pv" not in both(data, tmp_path).row.flags
    assert "stuck_pv" in both(data.assign(pv=50.0), tmp_path / "never").row.flags


def test_a_loop_at_rest_is_idle_and_not_stuck(tmp_path: Path) -> None:
    """PV, SP and OP all constant: idle, not stuck, not scored."""
    found = both(simulated(steps(1800), noise=0.0), tmp_path)
    assert "idle" in found.row.flags
    assert "stuck_pv" not in found.row.flags
    assert (found.row.verdict, found.row.events, found.row.ci_setpoint) == (NOT_ASSESSED, 0, None)


def test_a_gateway_that_repeats_its_last_values(tmp_path: Path) -> None:
    """Times go on, values are repeated with good quality: as a loop at rest; no event, never called good."""
    data = good(2400, at=2000)
    data.loc[300:, ["sp", "pv", "op"]] = data.loc[299, ["sp", "pv", "op"]].to_numpy()
    found = both(data, tmp_path)
    assert {"idle", "stuck_pv"} & set(found.row.flags)
    assert found.row.events == 0
    no_settings(found)


def test_a_gateway_that_repeats_with_the_sources_own_time(tmp_path: Path) -> None:
    """The source's time tells: each repeat is a duplicate, and the loop is stale."""
    monitor = Live(tmp_path)
    rows = messages(good(200))
    for k in range(200):
        monitor.put(rows[min(k, 100)], 1.0)
    assert monitor.status()["loops"]["stale"] == 1
    found = monitor.outcome()
    monitor.close()
    found.counted(ok=101, duplicate=99)
    assert "stale" in found.row.flags


# ---------------------------------------------------------------------------------------------------
# what a historian makes of it


def swinging_door(data: pd.DataFrame, deviation: float) -> np.ndarray:
    """Which rows a historian keeps: those between which a line misses no PV by more than the deviation."""
    t, y = np.arange(len(data), dtype=float), data["pv"].to_numpy()
    kept, first, low, high = [0], 0, -np.inf, np.inf
    for k in range(1, len(y)):
        dt = t[k] - t[first]
        low, high = (
            max(low, (y[k] - deviation - y[first]) / dt),
            min(high, (y[k] + deviation - y[first]) / dt),
        )
        if low > high:
            first = k - 1
            kept.append(first)
            low, high = (y[k] - deviation - y[first]), (y[k] + deviation - y[first])
    return np.array([*kept, len(y) - 1])


def test_a_compressed_pv_is_marked(tmp_path: Path) -> None:
    """Swinging doors, then interpolated at even times: runs of points on one line; said, and not called good."""
    data = simulated(steps(4000, (1500, 5.0), (3000, -5.0)), noise=0.1)
    kept = swinging_door(data, 0.5)
    assert len(kept) < len(data) / 8
    data["pv"] = np.interp(np.arange(len(data)), kept, data["pv"].to_numpy()[kept])
    found = both(data, tmp_path)
    assert "compressed" in found.row.flags
    assert found.row.compression > 0.5
    assert found.row.harris is None


def test_values_written_only_on_change_are_held(clean: Outcome, tmp_path: Path) -> None:
    """Set point and output reported by exception hold until the next, live by tag as in the file; no line is drawn."""
    data = good(N).assign(op=lambda d: d["op"].round(1))
    whole = both(data, tmp_path / "whole", payloads=("sample",))
    sparse = data.copy()
    for column in ("sp", "op"):
        sparse[column] = data[column].where(data[column].diff().ne(0))
    assert sparse["sp"].notna().sum() == 2
    sparse["op"] = sparse["op"].where(sparse["op"].notna())
    found = live(sparse, tmp_path / "tag", "tag")
    same(found, whole)
    if sparse["op"].isna().mean() > 0.5:
        filed = audit(sparse, tmp_path / "a")
        same(filed, whole)
        assert filed.about["held_where_empty"] == {"data.csv": ["op", "sp"]}
    assert whole.event.id == clean.event.id


def test_a_pv_reported_by_exception(tmp_path: Path) -> None:
    """PV with a dead band, its last value repeated: a staircase is not a stuck sensor, and a step is still seen."""
    data = simulated(steps(1500, (700, 5.0)), noise=0.0)
    held = data["pv"].to_numpy().copy()
    for k in range(1, len(held)):
        if abs(held[k] - held[k - 1]) < 0.2:
            held[k] = held[k - 1]
    found = both(data.assign(pv=held), tmp_path)
    assert found.events[0].start == (START + 700) * SECOND
    assert "stuck_pv" not in found.row.flags


def test_minute_averages_of_a_fast_loop(tmp_path: Path) -> None:
    """A loop that settles within a few samples: too coarse; neither called good nor given settings."""
    sp = steps(30_000, *((k, 5.0 if k // 3000 % 2 else -5.0) for k in range(3000, 30_000, 3000)))
    data = simulated(sp)
    block = data.groupby(np.arange(len(data)) // 60)
    averages = block.mean(numeric_only=True).assign(loop=NAME, time=block["time"].last())
    found = both(averages.reset_index(drop=True), tmp_path, payloads=("frame",))
    assert "undersampled" in found.row.flags
    assert (found.row.oscillation_period, found.row.harris) == (None, None)
    no_settings(found)


@pytest.mark.parametrize("bits", [8, 10, 12])
def test_a_coarse_transmitter(tmp_path: Path, bits: int) -> None:
    """PV in steps of 100 / 2^bits: one event, no false step, not stuck; PV's step is told where it shows."""
    data = simulated(steps(2000, (1000, 5.0)))
    lsb = 100.0 / 2**bits
    found = both(data.assign(pv=(data["pv"] / lsb).round() * lsb), tmp_path)
    assert [(e.kind, e.start) for e in found.events] == [("setpoint", (START + 1000) * SECOND)]
    if bits > 8:  # eight bits hide all noise: PV hardly ever moves
        assert found.row.quantum == pytest.approx(lsb, rel=0.01)
    assert "stuck_pv" not in found.row.flags


@pytest.mark.parametrize("at", [150, 320])
def test_a_spike_is_no_step(clean: Outcome, tmp_path: Path, at: int) -> None:
    """One sample of twenty standard deviations, at rest or in the response: no event, no inflated noise."""
    data = good(N)
    data.loc[at, "pv"] += 20 * 0.02
    found = both(data, tmp_path)
    assert [e.id for e in found.events] == [clean.event.id]
    assert found.row.noise is None or found.row.noise < 1.2 * clean.row.noise
    assert found.event.iae == pytest.approx(clean.event.iae, rel=0.02)
    assert found.row.verdict == GOOD


def test_other_units_in_mid_stream(tmp_path: Path) -> None:
    """SP and PV jump together, as from °C to °F: a change of configuration, not a step of the process."""
    data = good(3000, at=2500, size=0.0)
    changed = data.index >= 1500
    for column in ("sp", "pv"):
        data[column] = data[column].where(~changed, 1.8 * data[column] + 32.0)
    found = both(data, tmp_path)
    assert not found.events
    assert "config_change" in found.row.flags


def test_a_range_that_changes_holds_from_then_on(tmp_path: Path) -> None:
    """New ranges by a settings message: samples are judged by the range of their time; past events keep theirs."""
    monitor = Live(tmp_path, [{**SETTINGS, "pv_low": 49.0, "pv_high": 51.0}])
    rows = messages(good(N, size=0.0).assign(pv=75.0))
    for k, single in enumerate(rows):
        if k == 300:
            monitor.wait(3.0)
            monitor.put([("plant/LIC-101/settings", b'{"pv_high": 60.0, "op_high": 70.0}')])
        monitor.put(single, 1.0)
    assert monitor.loops[0].pv_high == 60.0
    assert monitor.service.engine.detector.param["op_high"][0] == 70.0
    found = monitor.outcome()
    monitor.close()
    found.counted(ok=N - 300, bad_value=300)


def test_swapped_tags(tmp_path: Path) -> None:
    """SP and PV exchanged: the noisy one cannot be a set point; said, and nothing is scored."""
    sp = steps(3000, *((k, 3.0 if k // 300 % 2 else -3.0) for k in range(300, 3000, 300)))
    data = simulated(sp, noise=0.1)
    found = both(data.rename(columns={"sp": "pv", "pv": "sp"}), tmp_path)
    assert "mapping_suspect" in found.row.flags
    no_settings(found)
    assert found.row.ci_setpoint is None


def test_an_output_that_belongs_to_another_loop(tmp_path: Path) -> None:
    """OP has nothing to do with PV: said, and no settings follow from it."""
    rng = np.random.default_rng(4)
    data = simulated(steps(4000, (1000, 5.0), (2500, -5.0)))
    other = 40.0 + np.cumsum(rng.normal(0, 0.05, len(data)))
    found = both(data.assign(op=other), tmp_path)
    assert found.row.new_kp is None
    assert "mapping_suspect" in found.row.flags


@pytest.mark.parametrize("late", [1, 2, 3, 5])
def test_an_output_that_arrives_late_is_its_own(tmp_path: Path, late: int) -> None:
    """OP stands some samples behind PV, at rest and with steps, as scans and gateways have it: no wrong tag."""
    for name, sp in (("rest", steps(4000)), ("moves", steps(4000, (1000, 5.0), (2500, -5.0)))):
        data = simulated(sp, noise=0.1)
        op = data["op"].shift(late).bfill()
        found = audit(data.assign(op=op), tmp_path / name)
        assert "mapping_suspect" not in found.row.flags, name


@pytest.mark.parametrize("shape", ["ramp", "staircase", "cascade"])
def test_a_set_point_that_moves_on_and_on_is_no_step(tmp_path: Path, shape: str) -> None:
    """A ramp, a staircase of one LSB, a master's every move: told as what it is, and not many steps."""
    n = 2000
    k = np.arange(n)
    sp = {
        "ramp": 50.0 + np.clip(k - 500, 0, 1000) * 0.01,
        "staircase": 50.0 + np.clip(k - 500, 0, 1000) // 10 * 0.024,
        "cascade": 50.0 + np.cumsum(np.random.default_rng(1).normal(0, 0.05, n)),
    }[shape]
    found = both(simulated(sp), tmp_path)
    moves = [e for e in found.events if e.kind == "setpoint"]
    assert 1 <= len(moves) <= 3
    assert all("the set point moved by" in e.reason and e.verdict != "retune" for e in moves)


def test_a_set_point_that_is_missing_holds(clean: Outcome, tmp_path: Path) -> None:
    """Live by tag it is sent only when it moves; in a file it stands only there: the same event."""
    data = good(N)
    data["sp"] = data["sp"].where(data["sp"].diff().ne(0))
    found = audit(data, tmp_path / "a")
    same(found, live(data, tmp_path / "l", "tag"))
    assert found.event.id == clean.event.id


# ---------------------------------------------------------------------------------------------------
# modes


def with_manual(n: int, first: int, last: int, bump: float = 0.0) -> pd.DataFrame:
    """A loop in manual from ``first`` to ``last``, PV drifting; taken over with SP = PV + bump."""
    data = simulated(steps(first), seed=1)
    level = float(data["pv"].iloc[-1])
    k = np.arange(last - first)
    noise = 0.02 * np.random.default_rng(2).normal(size=last - first)
    drift = pd.DataFrame(
        {"loop": NAME, "sp": 50.0, "pv": level + 0.004 * k + noise, "op": data["op"].iloc[-1], "auto": False}
    )
    end = float(drift["pv"].iloc[-1])
    rest = simulated(steps(n - last, (1, bump), start=end), seed=3)
    rest.loc[0, "sp"] = end + bump  # the loop begins to answer in automatic
    out = pd.concat([data.assign(auto=True), drift, rest.assign(auto=True)], ignore_index=True)
    return out.assign(time=START * SECOND + np.arange(n) * SECOND)


def test_manual_by_its_tag(tmp_path: Path) -> None:
    """Manual for two thirds of the time, set points moved meanwhile: no event, no index, the share is told."""
    data = with_manual(1800, 300, 1500)
    data.loc[600:900, "sp"] = 60.0
    found = both(data, tmp_path)
    assert not found.events
    assert found.row.manual == pytest.approx(1200 / 1800, abs=0.02)
    assert (found.row.verdict, found.row.new_kp) == (NOT_ASSESSED, None)
    assert "manual" in found.row.flags
    assert "manual" in found.row.reason


def test_an_event_ends_with_the_change_to_manual(tmp_path: Path) -> None:
    """The operator takes over in the middle of a response: interrupted, at the last sample in automatic."""
    data = good(N).assign(auto=True)
    data.loc[310:, "auto"] = False
    found = both(data, tmp_path)
    assert found.states == ["interrupted"]
    assert found.event.end == (START + 309) * SECOND
    assert "manual" in found.event.reason
    assert found.row.new_kp is None


@pytest.mark.parametrize("tracking", [False, True])
def test_manual_without_a_tag(tmp_path: Path, tracking: bool) -> None:
    """OP stands still while the error wanders, or SP follows PV: taken for manual, and not judged."""
    n = 4000
    rng = np.random.default_rng(6)
    pv = 50.0 + np.cumsum(rng.normal(0, 0.05, n))
    data = pd.DataFrame(
        {
            "loop": NAME,
            "time": START * SECOND + np.arange(n) * SECOND,
            "sp": pv if tracking else 50.0,
            "pv": pv,
            "op": 40.0,
        }
    )
    found = both(data, tmp_path)
    assert "manual" in found.row.flags
    no_settings(found)


@pytest.mark.parametrize("bump", [0.0, 3.0, -20.0])
def test_back_to_automatic(tmp_path: Path, bump: float) -> None:
    """Bumpless or with a bump: a new start from there; no event, nothing for the identification, the time is told."""
    data = with_manual(4000, 300, 800, bump)
    assert data["pv"][900:].mean() - data["pv"][799] == pytest.approx(bump, abs=1.0)
    found = both(data, tmp_path)
    assert not found.events
    assert (found.row.events, found.row.gain, found.row.verdict) == (0, None, NOT_ASSESSED)
    assert found.row.manual == pytest.approx(500 / 4000, abs=0.01)


# ---------------------------------------------------------------------------------------------------
# valve, action, loads


def test_an_output_at_its_limit(tmp_path: Path) -> None:
    """A tenth of the response at a known limit: told, no index, the model stays. Without limits by where OP rests."""
    data = simulated(steps(1200, (300, 30.0)), kp=14.0, high=100.0)
    assert (data["op"] >= 100.0).sum() > 40
    limited = both(data, tmp_path / "known", table=[{**SETTINGS, "op_low": 0.0, "op_high": 100.0}])
    assert limited.row.saturation > 0.03
    assert limited.event.ci is None
    assert "OP was at its limit" in limited.event.reason
    assert limited.event.gain == pytest.approx(0.01, rel=0.05)
    assert (limited.row.verdict, limited.row.new_kp) == (GOOD, None)
    unknown = both(data, tmp_path / "unknown")
    assert unknown.row.saturation == pytest.approx(
        limited.row.saturation, abs=0.01
    )  # OP rests at its own extreme


def test_a_sticking_valve(tmp_path: Path) -> None:
    """OP ramps, PV stands and jumps, in a flow loop with good settings: the valve's; no retune is suggested."""
    spec = replace(troubles(1)[0], period=1.0)
    block = Simulation([spec], START).advance(3600.0)
    (row,) = loop_table([spec])
    data = pd.DataFrame(
        {"loop": spec.name, "time": block.time_ns, "sp": block.sp, "pv": block.pv, "op": block.op}
    )
    found = both(data, tmp_path, table=[row], payloads=("frame",), every=120.0)
    assert "stiction" in found.row.flags
    no_settings(found)


def test_reverse_and_direct_action(clean: Outcome, tmp_path: Path) -> None:
    """A plant of negative gain under a direct-acting controller: the sign is found, the verdict is the same."""
    data = good(N).assign(op=lambda d: 80.0 - d["op"])
    found = both(data, tmp_path / "direct", table=[{**SETTINGS, "kp": -14.0}])
    assert found.row.verdict == clean.row.verdict
    assert found.row.gain == pytest.approx(-clean.row.gain, rel=0.01)
    slow = simulated(steps(2500, (300, 5.0)), kp=2.0, ti=600.0).assign(op=lambda d: 80.0 - d["op"])
    kept = both(slow, tmp_path / "slow", table=[{**SETTINGS, "kp": -2.0, "ti": 600.0}])
    assert kept.row.new_kp is None or kept.row.new_kp < 0
    wrong = both(slow, tmp_path / "wrong", table=[{**SETTINGS, "kp": 2.0, "ti": 600.0}])
    assert wrong.row.new_kp is None
    assert wrong.row.verdict != GOOD


def test_a_load_step_is_no_set_point_step(tmp_path: Path) -> None:
    """PV moves, SP does not: an event of its own kind with an index of its own, or none; never a set-point event."""
    load = np.where(np.arange(2000) >= 1000, 12.0, 0.0)
    found = both(simulated(steps(2000), load=load, dead=3), tmp_path)
    assert {e.kind for e in found.events} <= {"load"}
    assert found.row.ci_setpoint is None
    assert [e.kind for e in found.events] == ["load"]
    assert found.row.ci_load is not None
    assert abs(found.event.start - (START + 1000) * SECOND) < 20 * SECOND


def test_a_second_step_before_the_first_has_settled(tmp_path: Path) -> None:
    """The first closes as interrupted where the second begins; each says so; the figures are finite."""
    found = both(simulated(steps(900, (300, 5.0), (308, 3.0))), tmp_path)
    assert found.states[0] == "interrupted"
    assert len(found.events) == 2
    assert found.events[0].end <= found.events[1].start + SECOND
    assert "set point moved again" in found.events[0].reason


def test_a_step_below_the_noise_is_none(tmp_path: Path) -> None:
    """Half a standard deviation of the error: not seen, and nothing else is."""
    found = both(simulated(steps(2000, (1000, 0.1)), noise=0.2, kp=2.0), tmp_path)
    assert not found.events


def test_a_drift_over_months_makes_no_series_of_alarms(tmp_path: Path) -> None:
    """A month of a slowly drifting load and level at a sample a minute: followed; hardly an event."""
    n = 30 * 1440
    drift = np.linspace(0.0, 20.0, n)
    data = simulated(steps(n), period=60.0, kp=0.2, ti=3600.0, noise=0.1, load=drift * 0.01)
    found = both(
        data, tmp_path, table=[{"name": NAME, "kp": 0.2, "ti": 3600.0}], payloads=("frame",), every=20_000.0
    )
    assert len(found.events) <= 2
    assert found.row.verdict in {GOOD, NOT_ASSESSED, INCONCLUSIVE}


def test_quiet_at_first(tmp_path: Path) -> None:
    """Noise that grows a hundredfold is followed within some blocks."""
    data = simulated(steps(6000))
    data.loc[3000:, "pv"] += np.random.default_rng(1).normal(0, 2.0, 3000)
    assert both(data, tmp_path, payloads=("frame",)).row.noise == pytest.approx(2.0, rel=0.1)


def test_constant_at_first(tmp_path: Path) -> None:
    """No variance at all for ten minutes, then a step: no division, one event, figures that are finite."""
    found = both(simulated(steps(1200, (600, 5.0)), noise=0.0), tmp_path)
    assert [(e.kind, e.start) for e in found.events] == [("setpoint", (START + 600) * SECOND)]
    figures: list[Any] = [getattr(found.row, n) for n in found.row.__struct_fields__]
    assert all(np.isfinite(v) for v in figures if isinstance(v, float) and v != found.row.ti)
