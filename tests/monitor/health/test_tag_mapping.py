"""Tags that belong to other signals are suspected."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

from tests.monitor.health.tools import N, health, noise


def test_wrong_tags_are_suspected():
    """SP and PV swapped; an OP that does not hear the error; an SP that tracks PV. Not a P controller in noise."""
    rests = 50 + np.repeat(noise(N // 500, 3), 500)
    assert health(50 + noise(), rests, 30 + noise(seed=1)).mapping
    assert health(50.0, 50 + noise(), 30 + noise(seed=1)).mapping
    tracks = health(50 + noise(), 50 + noise(), 30.0)
    assert tracks.mapping
    assert tracks.held == 1
    assert not health(50.0, 50 + noise(), 30 - noise()).mapping
    assert not health(50.0, 50 + noise(), 30 - np.cumsum(0.1 * noise())).mapping


def test_an_output_that_rests_while_the_error_moves_is_held():
    """From 200 samples on; not if it is at its limit."""
    e = np.cumsum(0.1 * noise())
    assert health(50.0, 50 - e, 30.0).held == pytest.approx(1, abs=0.1)
    assert health(50.0, 50 - e, 100.0, op_high=100.0).held == 0
    assert health(50.0, 50 - e, 30 + e).held == 0


def test_a_moving_set_point_is_seen():
    """A cascade's slave, a ramp; two steps are two samples."""
    assert health(50 + noise(), 50 + noise(seed=1), 30.0).sp_moving == pytest.approx(1)
    assert health(np.where(np.arange(N) > 1000, 51.0, 50.0), 50 + noise(), 30.0).sp_moving == pytest.approx(
        1 / N, rel=0.1
    )


@pytest.mark.parametrize("at", [10, 600, 2000])
@pytest.mark.parametrize("value", [-999.25, 0.0, 1e5])
def test_one_odd_value_does_not_condemn_the_tags(at, value):
    """Of PV or of SP, OP takes no notice: the loop is as well wired as before, and as well sampled."""
    e = 0.1 * noise()
    sp = 50.0 + 5 * (np.arange(N) % 1000 >= 500)
    op = 30 + 0.3 * e + 0.01 * np.cumsum(e)
    odd = np.arange(N) == at
    for found in (health(sp, np.where(odd, value, sp - e), op), health(np.where(odd, value, sp), sp - e, op)):
        assert not found.mapping
    slow = 50 + lfilter([0, 0.05], [1, -0.95], sp - 50) + e
    assert not health(np.where(odd, value, sp), slow, op).undersampled
