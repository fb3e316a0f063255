"""What the tests of several packages share."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pandas as pd
import pytest

from monitor.adapters.rerun_view import process as rerun_process
from monitor.engine import Engine
from sim_plants.scenarios import demo
from sim_plants.specs import LoopSpec
from tests.monitor.audit.tools import step_test
from tests.support.fake_monitor import FakeMonitor, Loop, demo_loops
from tests.support.runs import Seen, watch


@pytest.fixture(scope="session")
def fleet_data() -> pd.DataFrame:
    parts = [step_test(f"LIC-{k}", seed=k) for k in range(5)]
    data = pd.concat(parts).sort_values(["time", "loop"], kind="stable").reset_index(drop=True)
    return data.assign(time=pd.to_datetime(data["time"], utc=True))


@pytest.fixture
def table(tmp_path: Path) -> Path:
    path = tmp_path / "table.csv"
    path.write_text("name,kp,ti\n" + "".join(f"LIC-{k},8,40\n" for k in range(5)))
    return path


@pytest.fixture
def loop() -> Loop:
    return demo_loops()[0]


@pytest.fixture
def fake() -> Iterator[FakeMonitor]:
    monitor = FakeMonitor(rerun_process.free_ports(1)[0], demo_loops())
    yield monitor
    monitor.close()


@pytest.fixture(scope="session")
def watched() -> tuple[list[LoopSpec], Engine, Seen]:
    """An hour of the demo's loops."""
    specs = demo(0)
    engine, seen = watch(specs, 3600.0)
    return specs, engine, seen


@pytest.fixture
def file(tmp_path: Path) -> Path:
    return tmp_path / "data.csv"
