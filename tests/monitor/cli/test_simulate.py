"""The command `loopsight simulate`."""

from __future__ import annotations

import pytest

from tests.monitor.cli.tools import refused, run
from tests.support.waiting import free_port


@pytest.mark.usefixtures("impatient")
def test_a_plant_without_a_monitor_is_one_line():
    """Nothing listens."""
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    refused("simulate", "--connect", endpoint, "--seconds", "1", names=endpoint)


def test_an_export_that_cannot_be_written_is_one_line(tmp_path):
    """A file where the folder should be."""
    (tmp_path / "x").write_text("")
    refused("simulate", "--scenario", "pumped-tank", "--hours", "0.01", "--out", str(tmp_path / "x"))
    refused("simulate", "--scenario", "pumped-tank", "--hours", "0.01", "--out", str(tmp_path / "x" / "y"))


def test_an_export_is_written(tmp_path):
    """Data, table and truth, with what the contract says of their columns."""
    out = tmp_path / "out"
    done = run("simulate", "--scenario", "pumped-tank", "--hours", "0.1", "--out", str(out))
    assert done.returncode == 0, done.stderr
    assert {p.name for p in out.iterdir()} == {"data.parquet", "loops.csv", "truth.csv", "truth_events.csv"}
    assert (out / "truth.csv").read_text().startswith("loop,process,gain,t0,dead_time,lag")
    assert (out / "truth_events.csv").read_text().startswith("loop,kind,onset,amplitude")
