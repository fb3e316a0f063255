"""Recorded loops of a refinery, with an engineer's reading, where they lie beside the repository."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache

import numpy as np
import pandas as pd
import pytest

from tests.monitor.health.cycles import Array
from tests.support.places import SHARED

PLANT = SHARED / "data" / "plant"
needed = pytest.mark.skipif(not PLANT.is_dir(), reason="../shared/data/plant is not there")


@cache
def _frames() -> tuple[pd.DataFrame, pd.DataFrame]:
    return pd.read_parquet(PLANT / "data.parquet"), pd.read_csv(PLANT / "labels.csv")


def records() -> Iterator[tuple[str, Array, Array, Array, float]]:
    """Yield label, SP, PV, OP and sample period [s]."""
    data, labels = _frames()
    for loop, label in labels.itertuples(index=False):
        own = data[data.loop == loop]
        sp, pv, op = (own[c].to_numpy(dtype=np.float64) for c in ("sp", "pv", "op"))
        yield label, sp, pv, op, float(own.time.diff().dt.total_seconds().median())


def noise_of(pv: Array) -> float:
    """Return the deviation of what PV does from sample to sample, by the middle of its moves [PV]."""
    moves = np.diff(pv)
    return 1.4826 * float(np.median(np.abs(moves - np.median(moves)))) / float(np.sqrt(2.0))
