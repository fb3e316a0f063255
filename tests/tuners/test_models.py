"""Models and their frequency responses."""

import math

import numpy as np
import pytest

from tuners.models import IntegratingModel, Plant, SelfRegulatingModel


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
