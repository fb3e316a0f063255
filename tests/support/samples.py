"""Batches of samples, put together."""

from __future__ import annotations

from dataclasses import fields

import numpy as np

from monitor.contract.samples import Samples


def join(parts: list[Samples]) -> Samples:
    """Put batches one behind the other."""
    return Samples(*(np.concatenate([getattr(p, f.name) for p in parts]) for f in fields(Samples)))
