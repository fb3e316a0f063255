"""What all rows of the bad-data matrix are compared with."""

from __future__ import annotations

import pytest

from monitor.contract.records import GOOD
from monitor.service.warm_up import warm_up
from tests.bad_data.harness import Outcome, both, good


@pytest.fixture(scope="session")
def clean(tmp_path_factory: pytest.TempPathFactory) -> Outcome:
    """What the data of `good` say without any trouble."""
    found = both(good(700), tmp_path_factory.mktemp("clean"), payloads=("sample", "tag", "frame"))
    assert (found.row.verdict, found.states) == (GOOD, ["settled"])
    found.counted(ok=700)
    return found


@pytest.fixture(scope="session", autouse=True)
def compiled() -> None:
    """Compile before the first test, not within it."""
    warm_up()
