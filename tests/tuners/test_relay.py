"""Relay identification: the printed check, and relay tests simulated by a naive twin."""

import numpy as np
import pytest

from tuners.models import IntegratingModel
from tuners.relay import relay_ifopdt, relay_ipdt


def test_kaya_1999_printed_check():
    """IFOPDT with theta = 3, T = 1: P = 15.9446, a/h = 3.2933; as IPDT 3.9862 and .8262."""
    model = relay_ifopdt(1.0, 1.0, 15.9446, 3.2933)
    assert (model.lag, model.dead_time) == pytest.approx((1, 3), rel=2e-4)
    ipdt = relay_ipdt(1.0, 15.9446, 3.2933)
    assert (ipdt.dead_time, ipdt.gain) == pytest.approx((3.9862, 0.8262), abs=6e-5)


def test_switching_instants():
    """PV passes 0 a dead time before each edge of the relay arrives, and the cycle is symmetric."""
    found = relay_ifopdt(0.7, 1.5, 14.0, 1.5 * 0.7 * 2.9)
    lag, theta, q = found.lag, found.dead_time, 7.0
    assert lag > 0.5
    # Between edges PV = K h (t - q/2 - lag + 2 lag e^(-t/lag)/(1 + e^(-q/lag))), counted from the last arrival.
    pv = [t - q / 2 - lag * (1 - 2 * np.exp(-t / lag) / (1 + np.exp(-q / lag))) for t in (0.0, q - theta, q)]
    assert pv[1] == pytest.approx(0, abs=1e-9)
    assert pv[0] == pytest.approx(-pv[2])


def relay_test(model, relay, dt=0.002):
    """Plain simulation of the limit cycle: period and amplitude of its last cycle."""
    delay = round(model.dead_time / dt)
    inputs, flow, pv, edges, level = [relay] * (delay + 1), 0.0, 1e-9, [], []
    for k in range(int(40 * (model.dead_time + model.lag) / dt)):
        inputs.append(-relay if pv > 0 else relay)
        if inputs[-1] > inputs[-2]:
            edges.append(k)
        u = inputs[-1 - delay]
        flow = u + (flow - u) * np.exp(-dt / model.lag) if model.lag else u
        pv += model.gain * flow * dt
        level.append(pv)
    last = level[edges[-2] : edges[-1]]
    return (edges[-1] - edges[-2]) * dt, (max(last) - min(last)) / 2


@pytest.mark.parametrize("model", [IntegratingModel(0.7, 2.0), IntegratingModel(0.7, 2.0, 3.0)])
def test_relay_test_gives_the_model_back(model):
    period, amplitude = relay_test(model, 1.5)
    found = relay_ifopdt(0.7, 1.5, period, amplitude) if model.lag else relay_ipdt(1.5, period, amplitude)
    assert (found.gain, found.dead_time) == pytest.approx((model.gain, model.dead_time), rel=5e-3)
    assert found.lag == pytest.approx(model.lag, rel=0.01)


def test_arrays():
    found = relay_ifopdt(1.0, 1.0, np.array([15.9446, 15.9446]), np.array([3.2933, 3.5]))
    assert found.lag[0] == pytest.approx(1, rel=2e-4)
    assert found.lag[1] < found.lag[0]


@pytest.mark.parametrize(
    ("arguments", "names"),
    [
        ((1, 0, 10, 2), "relay"),
        ((1, 1, -1, 2), "period"),
        ((1, 1, 10, 0), "amplitude"),
        ((1, 1, 4, 2), "no lag"),
    ],
)
def test_wrong_cycle_is_named(arguments, names):
    with pytest.raises(ValueError, match=names):
        relay_ifopdt(*arguments)
