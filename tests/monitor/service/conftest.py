"""Services that are closed at the end of a test."""

from __future__ import annotations

from typing import Any

import pytest

from monitor.contract.loops import LoopTable
from tests.monitor.service.tools import Bench


@pytest.fixture
def bench(tmp_path):
    made = []

    def make(loops: LoopTable | None = None, **config: Any) -> Bench:
        made.append(Bench(tmp_path / str(len(made)), loops, **config))
        return made[-1]

    yield make
    for b in made:
        b.store.close()
