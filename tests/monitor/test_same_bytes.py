"""Killed and taken up again, by any number of processes, on a cluster: every file of an audit has the same bytes."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from monitor.audit.run import run_audit
from monitor.audit.settings import AuditSettings
from sim_plants.export import LAYOUT_START, data_name, write_export
from sim_plants.export_layouts import LAYOUTS
from sim_plants.scenarios import demo
from tests.monitor.audit.tools import content
from tests.support.waiting import PATIENCE, free_port

pytestmark = pytest.mark.slow
KILLS = 10


@pytest.fixture(scope="module")
def export(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Thirteen loops for an hour, flagged and good ones and one in manual, in three layouts."""
    folder = tmp_path_factory.mktemp("export")
    for name in (None, "european", "one-file-per-tag"):
        write_export(demo(1), 3600.0, folder, LAYOUT_START, LAYOUTS.get(name or ""))
    return folder


def started(*given: object) -> subprocess.Popen[bytes]:
    """Begin an audit, the leader of a group: its pool of processes is killed with it."""
    line = [sys.executable, "-m", "monitor", "audit", *map(str, given)]
    return subprocess.Popen(line, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, start_new_session=True)


def finished(*given: object) -> float:
    """Run an audit to its end; return the time that it took [s]."""
    begun = time.monotonic()
    with started(*given) as run:
        assert run.wait(PATIENCE) == 0, run.stderr and run.stderr.read()
    return time.monotonic() - begun


@pytest.mark.parametrize(
    ("layout", "jobs"),
    [
        (None, 1),
        *(
            pytest.param(*each, marks=pytest.mark.soak)
            for each in [(None, 4), ("european", 2), ("one-file-per-tag", 2)]
        ),
    ],
)
def test_killed_at_random_moments_and_resumed(
    export: Path, tmp_path: Path, layout: str | None, jobs: int
) -> None:
    """SIGKILL to all processes; what is done is kept, what is torn is done again, and nothing else is left behind."""
    given = (export / data_name(LAYOUTS.get(layout or "")), "--loops", export / "loops.csv", "--jobs", jobs)
    took = finished(*given, "--out", tmp_path / "whole")
    rng = np.random.default_rng(jobs)
    for n, share in enumerate(rng.uniform(0.3, 1.0, -(-KILLS // 4))):
        out = tmp_path / f"killed-{n}"
        with started(*given, "--out", out) as run:
            time.sleep(share * took)
            with suppress(ProcessLookupError):
                os.killpg(run.pid, signal.SIGKILL)
        finished(*given, "--out", out, "--resume")
        assert content(out) == content(tmp_path / "whole"), f"killed after {share * took:.2f} s"
        assert sorted(p.name for p in out.iterdir()) == sorted(p.name for p in (tmp_path / "whole").iterdir())


def test_any_number_of_processes(export: Path, tmp_path: Path) -> None:
    """One, two and four, as a user starts them."""
    found = []
    for jobs in (1, 2, 4):
        out = tmp_path / str(jobs)
        finished(export / "data.parquet", "--loops", export / "loops.csv", "--jobs", jobs, "--out", out)
        found.append(content(out))
    assert found[0] == found[1] == found[2]


# -- a cluster: its library is an extra --------------------------------------------------------------
@contextmanager
def local_cluster(workers: int) -> Iterator[str]:
    """A Dask cluster of this machine; its address."""
    distributed: Any = pytest.importorskip("distributed")
    with distributed.LocalCluster(
        n_workers=workers, threads_per_worker=1, dashboard_address=None, protocol="tcp"
    ) as cluster:
        yield cluster.scheduler_address


def test_a_cluster_gives_the_same(export: Path, tmp_path: Path) -> None:
    given = ([export / "data.parquet"], export / "loops.csv")
    run_audit(*given, tmp_path / "here", AuditSettings(jobs=4))
    with local_cluster(2) as address:
        run_audit(*given, tmp_path / "there", AuditSettings(jobs=4, scheduler=address))
    assert content(tmp_path / "there") == content(tmp_path / "here")


def test_nobody_to_do_the_work_is_one_line(export: Path, tmp_path: Path) -> None:
    """Nothing listens, nobody answers, or a scheduler has no worker: said before anything is read."""
    with local_cluster(0) as idle, socket.create_server(("127.0.0.1", 0)) as mute:
        for address, said in (
            (f"tcp://127.0.0.1:{mute.getsockname()[1]}", "nothing comes back"),
            (f"tcp://127.0.0.1:{free_port()}", "no Dask scheduler answers"),
            (idle, "no worker"),
        ):
            begun = time.monotonic()
            with pytest.raises(OSError, match=said) as refused:
                run_audit([export / "data.parquet"], None, tmp_path / "out", AuditSettings(scheduler=address))
            assert time.monotonic() - begun < 10.0
            assert "\n" not in str(refused.value)
            assert not (tmp_path / "out").exists()
