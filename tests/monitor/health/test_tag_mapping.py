"""Tags that belong to other signals are suspected."""

from __future__ import annotations

import math

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


def test_a_change_of_unit_is_not_a_step():
    """degC to degF on SP and PV at once; a set-point step that PV follows at once by OP is a step."""
    later = np.arange(N) >= 1500
    pv = 50 + 0.3 * noise()
    sp = np.where(later, 122.0, 50.0)
    assert health(sp, np.where(later, 1.8 * pv + 32, pv), 30 - 0.1 * noise()).config_change
    assert not health(sp, pv + 72 * later, 30 - 0.1 * noise() + 20 * later).config_change
    assert not health(50.0, pv, 30 - 0.1 * noise()).config_change


@pytest.mark.parametrize(("lag", "coarse"), [(0.5, True), (20.0, False)])
def test_a_response_over_before_it_is_seen_is_undersampled(lag, coarse):
    """PV follows SP with a lag of half a sample, or of twenty."""
    sp = 50.0 + 5 * (np.arange(N) % 600 >= 300)
    a = math.exp(-1 / lag)
    pv = 50 + lfilter([0, 1 - a], [1, -a], sp - 50) + 0.1 * noise()
    assert health(sp, pv, 30 - 0.1 * noise() + sp).undersampled is coarse


def test_a_set_point_clicked_up_in_stages_is_not_answered_within_two_samples():
    """PV that still moves towards the stages before the last, which is a small one, is no fast answer to that."""
    at = np.arange(N) % 1000
    up = np.select([at == 300, at == 301, at == 302], [2.0, 2.5, 0.5])
    down = np.select([at == 800, at == 801, at == 802], [2.0, 2.5, 0.5])
    sp = 50.0 + np.cumsum(up - down)
    slow = 50 + lfilter([0, 0.06], [1, -0.94], sp - 50)
    assert not health(sp, slow, 30 + 0.5 * (sp - slow)).undersampled
