"""Situations of real plants that went wrong once, whose right answers are known.

The data lie beside the repository (``../shared/cases``); where they do not, these tests are skipped. Each stands for a
kind, whose simulated variants are in `tests.bench.beginnings`, `tests.bench.upsets` and the tests of the modules.
"""

from __future__ import annotations

from functools import cache

import numpy as np
import pandas as pd
import pytest

from monitor.adapters.loop_table import read_loop_table
from monitor.contract.records import GOOD, RETUNE, Assessment, LoopRow
from monitor.contract.samples import Samples
from monitor.engine import Engine
from tests.support.places import SHARED
from tests.support.runs import sorted_records

CASES = SHARED / "cases"
pytestmark = pytest.mark.skipif(not CASES.is_dir(), reason="../shared/cases is not there")


@cache
def seen(case: str) -> tuple[dict[str, LoopRow], dict[str, list[Assessment]], int]:
    """Rows and assessments by loop, and the first sample's time [ns]."""
    (path,) = (p for p in (CASES / case).iterdir() if p.name in {"data.csv", "data.parquet"})
    frame = pd.read_csv(path) if path.suffix == ".csv" else pd.read_parquet(path)
    table = read_loop_table(CASES / case / "loops.csv")
    numeric = pd.api.types.is_numeric_dtype(frame["time"])
    stamps = pd.to_datetime(frame["time"], unit="s" if numeric else None, utc=True)
    time = stamps.astype("datetime64[ns, UTC]").astype(np.int64).to_numpy()
    order = np.argsort(time, kind="stable")
    rows = frame["loop"].map(table.by_name).to_numpy()
    auto = frame["auto"].to_numpy(bool) if "auto" in frame else True
    values = [frame[c].to_numpy(np.float64) for c in ("sp", "pv", "op")]
    engine = Engine(table)
    samples = Samples.of(rows, time, *values, auto).take(order)
    found = sorted_records(engine.step(samples) + engine.flush()).assessments
    by_loop = {row.loop: [a for a in found if a.loop == row.loop] for row in engine.rows()}
    return {row.loop: row for row in engine.rows()}, by_loop, int(time.min())


def starts(case: str, loop: str, kind: str = "setpoint") -> list[float]:
    """Begins of a loop's events of a kind, from the first sample [s]."""
    _, found, first = seen(case)
    return [(a.start - first) * 1e-9 for a in found[loop] if a.kind == kind]


def test_steps_after_a_warm_up_are_found():
    rows, _, _ = seen("boiler-warm-up")
    assert starts("boiler-warm-up", "BOILER")[-2:] == pytest.approx([2400.0, 3300.0], abs=2.0)
    assert starts("boiler-warm-up", "BOILER", "load") == []
    assert rows["BOILER"].gain == pytest.approx(2.5e-4, rel=0.1)
    assert rows["BOILER"].events == 3


def test_a_bump_at_automatic_is_no_load_and_the_step_in_automatic_is_found():
    rows, _, _ = seen("batch-manual-auto")
    assert starts("batch-manual-auto", "BATCH", "load") == []
    assert starts("batch-manual-auto", "BATCH") == pytest.approx([9000.0], abs=2.0)
    assert rows["BATCH"].gain == pytest.approx(0.02, rel=0.1)


@pytest.mark.parametrize("loop", ["EXC-pv", "EXC-all", "EXC-hold1s"])
def test_rows_by_exception_show_both_steps(loop):
    rows, found, _ = seen("exception-reporting")
    steps = [a for a in found[loop] if a.kind == "setpoint"]
    assert [round(a.amplitude) for a in steps] == [6, -6]
    assert rows[loop].verdict == RETUNE
    assert rows[loop].gain == pytest.approx(0.01, rel=0.15)


def test_a_set_point_ramped_in_the_block_is_named_and_no_retune():
    rows, found, _ = seen("setpoint-ramped-in-block")
    row = rows["SPRAMP"]
    assert row.verdict != RETUNE
    assert "ramps its set point by 0.02 [PV/s]" in row.reason
    assert all(a.verdict != RETUNE for a in found["SPRAMP"])


def test_ramps_are_recorded_and_identified():
    truth = pd.read_csv(CASES / "fleet-setpoint-ramps" / "truth.csv").set_index("loop")
    rows, found, _ = seen("fleet-setpoint-ramps")
    for loop, true in truth.iterrows():
        (ramp,) = [a for a in found[str(loop)] if a.kind == "setpoint"]
        assert ramp.amplitude == pytest.approx(5.0)
        assert ramp.gain == pytest.approx(true["gain"], rel=0.1)
        assert "the set point moved by +5 [PV]" in rows[str(loop)].reason


def test_a_loop_that_follows_well_and_recovers_slowly_is_not_good():
    truth = pd.read_csv(CASES / "fleet-good-but-slow" / "truth.csv").set_index("loop")
    rows, _, _ = seen("fleet-good-but-slow")
    for loop, true in truth.iterrows():
        row = rows[str(loop)]
        assert row.verdict == RETUNE
        predicted = float(row.reason.split("CI_ld = ")[1].split()[0])
        assert predicted == pytest.approx(true["ci_today"], rel=0.2)


def test_compressed_data_give_a_gain_with_an_interval_that_holds():
    truth = pd.read_csv(CASES / "fleet-compressed" / "truth.csv").set_index("loop")
    rows, _, _ = seen("fleet-compressed")
    known = [row for row in rows.values() if row.gain is not None]
    assert len(known) >= 4
    for row in known:
        assert row.gain_lo is not None
        assert row.gain_hi is not None
        assert row.gain_lo <= truth.loc[row.loop, "gain"] <= row.gain_hi
        assert "compressed" in row.flags


def test_what_happens_while_the_slave_is_in_local_is_not_used():
    rows, found, first = seen("cascade-slave-in-local")
    local = [a for a in found["TIC-master"] if 5400e9 <= a.start - first <= 10_800e9]
    assert local
    assert all(a.ci is None and a.verdict not in {GOOD, RETUNE} for a in local)
    assert rows["TIC-master"].gain == pytest.approx(0.4, rel=0.1)


def test_under_an_override_the_clean_step_is_found():
    _, found, first = seen("low-select-override")
    step = next(a for a in found["LIC-override"] if a.kind == "setpoint")
    assert (step.start - first) * 1e-9 == pytest.approx(1500.0, abs=2.0)
    assert step.gain == pytest.approx(0.01, rel=0.1)


def test_a_day_of_hunting_and_programmes_is_not_silent():
    rows, found, _ = seen("intermittent-hunting")
    assert found["TIC-1"]
    assert rows["TIC-1"].setpoint_moves
    assert "no set-point" not in rows["TIC-1"].reason


def test_an_integral_trap_is_named_from_the_cycle_alone_and_cured_by_a_longer_time():
    """No step in the record of the fryer; the evaporator gets its settings: the gain as it is, ten times Ti."""
    fryer = seen("fryer-level-cycle")[0]["FRYER-cycle"]
    assert "integral action is too strong" in fryer.reason
    assert "oscillating" in fryer.flags
    evaporator = seen("evaporator-cycle")[0]
    cycling = evaporator["EVAP-cycle"]
    assert cycling.new_ti is not None
    assert cycling.new_ti >= 40.0
    assert cycling.new_kp is not None
    assert cycling.new_kp >= 0.3
    assert "settings_mismatch" in evaporator["EVAP-tiwrong"].flags


def test_no_answer_is_said_and_never_integral_action_asked_for():
    rows, _, _ = seen("no-response")
    for row in rows.values():
        assert "no_response" in row.flags
        assert "add integral" not in f"{row.reason} {row.action}"
        assert row.new_kp is None


def test_a_relay_in_place_of_the_demand_is_named():
    row = seen("relay-as-output")[0]["ROOM"]
    assert "two_valued_op" in row.flags
    assert "bottleneck" not in row.action
    assert row.new_kp is None


def test_gains_that_differ_with_the_level_are_named():
    row = seen("horizontal-drum")[0]["DRUM-horizontal"]
    assert "with PV below" in row.reason
    assert row.new_kp is None or row.new_kp <= 4.0


def test_settings_stay_below_what_an_inverse_response_and_an_oven_bear():
    drum = seen("drum-inverse-response")[0]["DRUM"]
    assert drum.new_kp is None or drum.new_kp < 2.7
    oven = seen("noisy-quantised-oven")[0]["OVEN"]
    assert oven.gain == pytest.approx(0.275, rel=0.1)
    assert not oven.new_td


@pytest.mark.parametrize("case", ["split-range", "slow-motor-valve", "drive-minimum-speed"])
def test_what_is_no_linear_loop_gets_no_settings(case):
    assert all(row.new_kp is None for row in seen(case)[0].values())
