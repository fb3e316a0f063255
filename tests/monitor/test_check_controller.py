"""`loopsight check` holds a loop table's settings against a sample of the data."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from monitor.check_controller import LEAST_SAMPLES, MOST_STRETCHES, STRETCH_SAMPLES, Sample, looked_at
from monitor.contract.loops import Loop
from monitor.contract.samples import Samples
from tests.monitor.cli.check_tools import check
from tests.support.controllers import Block, recorded
from tests.support.plants import times


def written(folder: Path, block: Block, **table: float) -> tuple[Path, Path]:
    """A loop's data and its table beside it."""
    sp, pv, op = recorded(block, noise=0.1)
    data, loops = folder / "data.csv", folder / "loops.csv"
    pd.DataFrame({"loop": "LIC-1", "time": np.arange(len(sp)), "sp": sp, "pv": pv, "op": op}).to_csv(
        data, index=False
    )
    pd.DataFrame({"name": ["LIC-1"], **{k: [v] for k, v in table.items()}}).to_csv(loops, index=False)
    return data, loops


@pytest.mark.parametrize("given", [True, False])
def test_a_wrong_table_is_a_problem_with_its_likely_cause(tmp_path: Path, given: bool) -> None:
    """Given with the data, or beside them."""
    data, loops = written(tmp_path, Block(), kp=1.5, ti=80.0 / 60.0)
    result = check(data, loops) if given else check(data)
    assert result.exit_code == 2
    assert f"{data}: loop LIC-1: OP behaves as with Ti = 80 s, the table says 1.33: minutes?" in result.stderr


def test_a_right_table_is_no_problem(tmp_path: Path) -> None:
    result = check(*written(tmp_path, Block(), kp=1.5, ti=80.0))
    assert (result.exit_code, result.stderr) == (0, "")
    assert "LIC-1" not in result.stdout


def test_a_filter_and_settings_that_no_table_has_are_notes(tmp_path: Path) -> None:
    result = check(*written(tmp_path, Block(pv_filter=9.0), kp=1.5, ti=80.0))
    assert result.exit_code == 0
    assert "loop LIC-1: OP behaves as with a PV filter of 9 s" in result.stdout
    result = check(*written(tmp_path, Block()))
    assert result.exit_code == 0
    assert "no settings in the table; seen: kp = 1.5 (1.5 to 1.5), ti = 80 (80 to 80) s" in result.stdout


def test_the_sample_is_bounded_and_holds_what_moves_most() -> None:
    n = 30 * STRETCH_SAMPLES
    rng = np.random.default_rng(0)
    sp = np.full(n, 50.0)
    sp[17 * STRETCH_SAMPLES + 100 :] = 55.0
    samples = Samples.of(0, times(n), sp, sp + rng.normal(0.0, 0.1, n), rng.normal(50.0, 0.1, n))
    sample = Sample()
    parts = [samples.take(slice(a, a + 777)) for a in range(0, n, 777)]
    assert sum(len(batch) for batch in sample.watched(iter(parts))) == n
    windows = sample.windows(0)
    assert len(windows) == MOST_STRETCHES
    assert all(LEAST_SAMPLES <= len(w) <= STRETCH_SAMPLES and period == 1.0 for w, period in windows)
    assert np.ptp(windows[0][0].sp) == 5.0
    assert sample.windows(7) == []


def test_manual_and_bad_samples_end_a_stretch() -> None:
    sp, pv, op = recorded(Block(), n=700, noise=0.1)
    auto = np.ones(700, bool)
    auto[300:310] = False
    pv[500] = np.nan
    sample = Sample()
    list(sample.watched(iter([Samples.of(0, times(700), sp, pv, op, auto)])))
    assert sorted(len(w) for w, _ in sample.windows(0)) == [190, 199, 300]


def test_what_is_not_resolved_is_not_said() -> None:
    rest = np.full(400, 50.0)
    sample = Sample()
    list(sample.watched(iter([Samples.of(0, times(400), rest, rest, rest)])))
    assert looked_at(["A"], sample, {"A": Loop(name="A", kp=1.0)}) == ([], [])
