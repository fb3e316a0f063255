"""Health figures of signals whose truth is known: PV, OP, tags, archives; streaming, scale, bad data, memory."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from monitor.contract.loops import Loop
from monitor.detect.detector import Detector
from monitor.health.observe import HEALTH
from tests.monitor.health.tools import look, mixed, run


@settings(max_examples=10)
@given(st.integers(1, 400))
def test_chunks_do_not_matter(chunk):
    """The sums are the same to the bit however the samples were cut."""
    whole, parts = run(mixed()), run(mixed(), chunk)
    assert whole.health.tobytes() == parts.health.tobytes()


def test_shares_and_means_equal_their_naive_twins_at_every_prefix():
    """In ten lines of plain Python."""
    samples = mixed(700)
    detector = Detector([Loop(name="L", period=1.0)])
    t, sp, pv, auto = (getattr(samples, n).tolist() for n in ("time", "sp", "pv", "auto"))
    good = hand = error = size = known = 0.0
    for k in range(len(samples)):
        detector.run(samples.take(slice(k, k + 1)))
        dt = (t[k] - t[k - 1]) * 1e-9 if k else 0.0
        if 0 < dt < 3.5:
            good += min(dt, 1.5)
            hand += 0.0 if auto[k - 1] else dt
            if auto[k - 1] and auto[k]:
                known += dt
                error += (sp[k - 1] - pv[k - 1]) * dt
                size += abs(sp[k - 1] - pv[k - 1]) * dt
        if known:
            found = look(detector)
            assert found.coverage == pytest.approx(good / ((t[k] - t[0]) * 1e-9))
            assert found.manual == pytest.approx(min(hand / good, 1))
            assert found.offset == pytest.approx(error / known)
            assert found.mean_abs_e == pytest.approx(size / known)


def test_bad_samples_leave_no_trace():
    """Not a number, infinite, a gateway's placeholder, of bad quality: the sums stay as they are."""
    clean = mixed(900)
    dirty = clean.take(np.repeat(np.arange(len(clean)), 2))
    bad = np.arange(len(dirty)) % 2 == 1
    kinds = np.array([np.nan, np.inf, -np.inf, 1e38])[np.arange(bad.sum()) % 4]
    dirty.pv[bad] = kinds
    dirty.time[bad] += 1
    assert run(clean).health.tobytes() == run(dirty).health.tobytes()


def test_memory_of_a_loop_is_small_and_constant():
    """A hundred thousand loops fit into half a gigabyte."""
    assert HEALTH.itemsize < 5200
