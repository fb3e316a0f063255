"""Models, their step responses, and the half rule."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import quad

from tuners.models import IntegratingModel, Plant, SelfRegulatingModel, half_rule, reduced_model

times = st.floats(0.01, 100)


def test_half_rule_of_skogestad_2003_integrating_example():
    """1/(s (s + 1)^2): theta 1.5 for PI; theta 0.5 and lag 1.5 for PID."""
    assert half_rule([1, 1], 0, order=1) == (1.5, 0.0)
    assert half_rule([1, 1], 0, order=2) == (0.5, 1.5)


# Skogestad 2003, examples E1, E2, E3: lags, zeros, then (gain factor, theta, lags) of order 1 and 2.
SKOGESTAD = {
    "E1": ([1, 0.2], [], (1, 0.1, 1.1), (1, 0, 1, 0.2)),
    "E2": ([2, 1, 0.4, 0.2, 0.05, 0.05, 0.05], [-0.3, 0.08], (1, 1.47, 2.5), (1, 0.77, 2, 1.2)),
    "E3": ([20, 1, 0.1, 0.1], [15], (0.75, 0.15, 1.05), (0.75, 0.05, 1, 0.15)),
}


@pytest.mark.parametrize("name", SKOGESTAD)
@pytest.mark.parametrize("order", [1, 2])
def test_skogestad_2003_examples(name, order):
    lags, zeros, *reduced = SKOGESTAD[name]
    model = reduced_model(1.0, lags, 0.0, order, zeros, process="self-regulating")
    gain, theta, *kept = reduced[order - 1]
    assert model.gain == pytest.approx(gain)
    assert model.dead_time == pytest.approx(theta)
    assert [model.lag, model.lag2][:order] == pytest.approx(kept)


@given(st.lists(times, max_size=6), times)
def test_half_rule_keeps_the_sum_of_lags_and_dead_time(lags, dead_time):
    theta, lag = half_rule(lags, dead_time)
    assert theta + lag == pytest.approx(sum(lags) + dead_time)


@given(st.lists(times, max_size=6), times)
def test_without_retained_lag_half_of_the_largest_goes_to_the_integrator(lags, dead_time):
    theta, lag = half_rule(lags, dead_time, order=1)
    assert lag == 0.0
    assert theta == pytest.approx(sum(lags) + dead_time - max(lags, default=0.0) / 2)


def test_right_half_plane_zero_adds_to_dead_time():
    assert half_rule([3], 1, order=2, zeros=[-0.5]) == (1.5, 3.0)


def test_zero_that_changes_the_gain_is_refused_by_half_rule_and_kept_by_reduced_model():
    with pytest.raises(ValueError, match="reduced_model"):
        half_rule([20, 1], 0.1, zeros=[15])
    assert reduced_model(2.0, [20, 1], 0.1, zeros=[15]).gain == pytest.approx(1.5)


@pytest.mark.parametrize(
    ("arguments", "names"),
    [
        (([1],  -1.0), "dead_time"),
        (([-1], 1.0), "lags"),
        (([1], 1.0, 3), "order"),
        (([1], 1.0, 2, (), "batch"), "process"),
        (([], 1.0, 2, (2.0,)), "zeros"),
    ],
)  # fmt: skip
def test_half_rule_names_what_is_wrong(arguments, names):
    *rest, process = arguments if len(arguments) == 5 else (*arguments, "integrating")
    with pytest.raises(ValueError, match=names):
        half_rule(*rest, process=process)


@pytest.mark.parametrize(
    ("kwargs", "field"),
    [
        ({"gain": 0.0, "dead_time": 1.0}, "gain"),
        ({"gain": math.inf, "dead_time": 1.0}, "gain"),
        ({"gain": 1.0, "dead_time": -1.0}, "dead_time"),
        ({"gain": 1.0, "dead_time": np.array([1.0, -2.0])}, "dead_time"),
        ({"gain": 1.0, "dead_time": 1.0, "lag": -0.1}, "lag"),
    ],
)
def test_wrong_model_names_the_field(kwargs, field):
    with pytest.raises(ValueError, match=field):
        IntegratingModel(**kwargs)
    with pytest.raises(ValueError, match=field):
        SelfRegulatingModel(**({"lag": 1.0} | kwargs))


def test_nan_is_a_missing_model_not_an_error():
    assert math.isnan(IntegratingModel(math.nan, 1.0).gain)


@pytest.mark.parametrize(
    "model",
    [
        IntegratingModel(-0.3, 2.0, 5.0),
        IntegratingModel(0.3, 2.0),
        SelfRegulatingModel(2.0, 1.0, 4.0, 3.0),
        SelfRegulatingModel(2.0, 1.0, 4.0, 4.0),
        SelfRegulatingModel(2.0, 1.0, 4.0),
        SelfRegulatingModel(2.0, 0.0, 0.0),
    ],
)
def test_step_response_is_the_integral_of_the_impulse_response(model):
    """Independent twin: convolve the impulse responses of the first-order parts by quadrature."""
    lags = [lag for lag in model.lags if lag > 0]

    def impulse(t):
        if not lags:
            return 0.0
        if len(lags) == 1:
            return math.exp(-t / lags[0]) / lags[0]
        a, b = lags
        return t / a**2 * math.exp(-t / a) if a == b else (math.exp(-t / a) - math.exp(-t / b)) / (a - b)

    for t in (0.5, 3.0, 11.0):
        age = max(t - model.dead_time, 0.0)
        weight = (lambda x, age=age: age - x) if model.process == "integrating" else (lambda _: 1.0)
        expected = quad(lambda x, weight=weight: impulse(x) * weight(x), 0, age)[0] if lags else weight(0)
        expected *= 1.0 if age > 0 or model.process == "integrating" or not lags else 0.0
        assert model.step_response(t) == pytest.approx(model.gain * expected, rel=2e-5, abs=1e-9)


def test_step_response_has_the_shape_of_time():
    assert IntegratingModel(1.0, 1.0, 2.0).step_response(np.linspace(0, 9, 10)).shape == (10,)


def test_plant_agrees_with_the_models():
    omega = np.geomspace(0.01, 10, 50)
    pairs = [
        (IntegratingModel(0.2, 3.0, 4.0), Plant(0.2, 3.0, (4.0,))),
        (SelfRegulatingModel(0.2, 3.0, 4.0, 1.0), Plant(0.2, 3.0, (1.0, 4.0), integrating=False)),
    ]
    for model, plant in pairs:
        np.testing.assert_allclose(plant.frequency_response(omega), model.frequency_response(omega))
        assert (plant.t0, plant.process) == (model.t0, model.process)


def test_reductions():
    assert IntegratingModel(1.0, 2.0, 3.0).without_lag() == IntegratingModel(1.0, 3.5)
    assert SelfRegulatingModel(1.0, 2.0, 3.0, 5.0).first_order() == SelfRegulatingModel(1.0, 3.5, 6.5)
