"""Health figures of signals whose truth is known: PV, OP, tags, archives; streaming, scale, bad data, memory."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from monitor.contract.loops import Loop
from monitor.detect.detector import Detector
from monitor.detect.state import QUIET
from monitor.health.observe import HEALTH
from tests.monitor.health.naive import TWINS, Seen
from tests.monitor.health.tools import mixed, run, samples_of


@settings(max_examples=10)
@given(st.integers(1, 400))
def test_chunks_do_not_matter(chunk):
    """The sums are the same to the bit however the samples were cut."""
    whole, parts = run(mixed()), run(mixed(), chunk)
    assert whole.health.tobytes() == parts.health.tobytes()


@pytest.fixture(scope="module")
def history() -> tuple[Seen, list[Any]]:
    """Samples with all that the sums must cope with, once a second, and a loop's record after each of them.

    Noise and a swing; PV in steps, at times the same; OP at its limits, held, and following; manual; a gap.
    """
    n = 1500
    rng = np.random.default_rng(5)
    k = np.arange(n)
    time = k + 500.0 * (k >= 900)
    pv = np.round(50 - np.sin(2 * np.pi * k / 17) - 0.2 * rng.normal(size=n), 3)
    pv[(k % 400 > 350) & (k % 3 > 0)] = 49.3
    op = np.clip(30 - 3 * (pv - 50) + 0.3 * rng.normal(size=n), 28, 32)
    op[1100:1350] = 30.0
    auto = (k < 450) | (k >= 470)
    detector = Detector([Loop(name="L", period=1.0, op_low=28.0, op_high=32.0)])
    samples = samples_of(50.0, pv, op, auto, time=time)
    records, quiet = [], []
    for at in range(n):
        quiet.append(bool(detector.state["phase"][0] <= QUIET))
        detector.run(samples.take(slice(at, at + 1)))
        records.append(detector.health[0].copy())
    return Seen(time, np.full(n, 50.0), pv, op, auto, np.array(quiet), 28.0, 32.0), records


@pytest.mark.parametrize("module", TWINS)
def test_sums_equal_their_naive_twins_at_every_prefix(history, module):
    """Every sum that a plain formula gives."""
    seen, records = history
    for n in range(2, len(records) + 1):
        if n > 200 and n % 7 and n < len(records):  # the formulas begin at the first sample each time
            continue
        for name, value in TWINS[module](seen.until(n)).items():
            found = records[n - 1][module][name]
            inside = value.items() if isinstance(value, dict) else [(None, value)]
            for field, expected in inside:
                part = found if field is None else found[field]
                least = part[: len(expected)] if field or name == "products" else part
                np.testing.assert_allclose(
                    least, expected, rtol=2e-5, atol=1e-8, err_msg=f"{n}: {name} {field}"
                )


def test_nothing_reaches_across_a_gap(history):
    """What is set anew before it is read may have been anything."""
    seen, _ = history
    samples = samples_of(seen.sp, seen.pv, seen.op, seen.auto, time=seen.time)
    one, other = (run(samples.take(slice(901)), op_low=28.0) for _ in range(2))
    for name in ("last", "middle", "side", "since"):
        other.health["travel"]["levels"][name] = 1e9
    other.health["autocorrelation"]["levels"]["block"] = 1e9
    for detector in (one, other):
        detector.run(samples.take(slice(901, None)))
    for module in TWINS:
        for a, b in zip(sums_of(one.health[module]), sums_of(other.health[module]), strict=True):
            np.testing.assert_array_equal(a, b)


def sums_of(record: Any) -> list[Any]:
    """Return the values of all fields, inner records too, but those that begin with the next average."""
    out = []
    for name in record.dtype.names:
        if record[name].dtype.names:
            out += sums_of(record[name])
        elif name not in {"last", "middle", "side", "since", "block"}:
            out.append(record[name])
    return out


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
