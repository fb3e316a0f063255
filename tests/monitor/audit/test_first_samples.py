"""Some samples of each loop."""

from __future__ import annotations

import numpy as np

from monitor.audit.first_samples import MOST_FIRST, FirstSamples
from monitor.contract.samples import Samples


def test_the_first_in_automatic_are_kept_and_no_more() -> None:
    n = 100_000
    auto = np.arange(n) % 2 == 0
    first = FirstSamples(3)
    for _ in range(3):
        first.watch(Samples.of(np.arange(n) % 4 // 2, np.arange(n), 1.0, 2.0, 3.0, auto))
    for row, kept in ((0, MOST_FIRST), (1, MOST_FIRST), (2, 0)):
        sp, pv = first.of(row)
        assert (len(sp), len(pv)) == (kept, kept)
        assert (sp == 1.0).all()
        assert (pv == 2.0).all()
