"""Rows as reports by exception send them, of samples at a rate."""

from __future__ import annotations

import numpy as np

from monitor.contract.samples import Samples


def by_exception(samples: Samples, band: float, longest: float, every: bool = True) -> Samples:
    """Return the rows of one loop that are sent: a value left its band, or ``longest`` [s] is over.

    With ``every`` OP has rows of its own.
    """
    columns = [samples.pv, samples.sp, samples.op][: 3 if every else 2]
    widths = [band, 0.0, band]
    sent, last = [c[0] for c in columns], [int(samples.time[0])] * len(columns)
    keep = np.zeros(len(samples), bool)
    keep[0] = True
    for k in range(1, len(samples)):
        for j, (column, width) in enumerate(zip(columns, widths, strict=False)):
            if abs(column[k] - sent[j]) > width or samples.time[k] - last[j] >= longest * 1e9:
                sent[j], last[j] = column[k], int(samples.time[k])
                keep[k] = True
    return samples.take(keep)
