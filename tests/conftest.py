"""What holds for all tests: one thread for the algebra, no waiting for the disk, and how Hypothesis draws."""

from __future__ import annotations

import gc
import os
from collections.abc import Iterator

import pytest
from hypothesis import HealthCheck, settings

# before numpy is imported: threads that wait for 3 x 3 matrices cost minutes
for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(name, "1")

# drawn anew each time, but the same in CI; without a deadline anywhere
COMMON = {"deadline": None, "suppress_health_check": [HealthCheck.too_slow]}  # a busy machine is no failure

settings.register_profile("random", **COMMON)
settings.register_profile("repeatable", **COMMON, derandomize=True, database=None)
settings.load_profile("repeatable" if os.environ.get("CI") else "random")


@pytest.fixture(scope="session", autouse=True)
def _no_waiting_for_the_disk() -> Iterator[None]:
    """What survives a power cut is not what is tested here."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(os, "fsync", lambda _: None)
        yield


@pytest.fixture
def impatient(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where nobody listens, that is found out at once."""
    monkeypatch.setattr("monitor.adapters.zenoh_bus.CONNECT_WITHIN_MS", 100)


def pytest_collection_finish() -> None:
    """What has been loaded stays: the collector need not look through it again and again, a tenth of all the time."""
    gc.collect()
    gc.freeze()
