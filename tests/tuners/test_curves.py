"""Step responses of many models at once: each is the exact response of its own loop."""

from __future__ import annotations

import numpy as np
import pytest

from tuners.curves import step_curves
from tuners.models import IntegratingModel, Model, SelfRegulatingModel
from tuners.responses import closed_loop_response
from tuners.settings import Settings

GAINS = np.array([[0.8], [1.0], [1.3]])
CASES = [
    (IntegratingModel, (1.0, 0.0), Settings(0.5, 8.0)),
    (IntegratingModel, (1.0, 3.0), Settings(0.3, 12.0, 1.0, 0.1, "series")),
    (SelfRegulatingModel, (1.0, 4.0), Settings(1.5, 4.0)),
    (SelfRegulatingModel, (0.5, 0.0), Settings(0.3, 1.0)),
    (SelfRegulatingModel, (1.0, 4.0, 2.0), Settings(2.0, 6.0, 1.0, 0.0, "standard", 0.0, 0.0)),
    (IntegratingModel, (1.0, 0.0), Settings(0.3)),
]


@pytest.mark.parametrize(("model", "times", "settings"), CASES)
@pytest.mark.parametrize("kind", ["setpoint", "load"])
def test_each_curve_is_the_response_of_its_own_model(
    model: type[Model], times: tuple[float, ...], settings: Settings, kind: str
) -> None:
    time = np.linspace(0.0, 60.0, 121)
    many = step_curves(model(GAINS, *(np.full((3, 1), t) for t in times)), settings, kind, time)
    for row, gain in zip(many, GAINS[:, 0], strict=True):
        exact = closed_loop_response(model(float(gain), *times), settings, kind, duration=61.0)
        expected = np.interp(time, exact.time, exact.pv)
        # a process without a lag jumps: the points on both sides of the jump are its neighbours'
        assert np.median(np.abs(row - expected)) < 2e-3 * np.abs(expected).max()
        assert np.abs(row - expected).max() < (0.02 if sum(times[1:]) > 0 else 1.1) * np.abs(expected).max()


def test_an_unstable_model_has_no_curve_and_the_others_have() -> None:
    curves = step_curves(
        IntegratingModel(np.array([[1.0], [9.0]]), np.ones((2, 1))),
        Settings(0.5, 8.0),
        "load",
        np.arange(5.0),
    )
    assert np.isfinite(curves[0]).all()
    assert np.isnan(curves[1]).all()


def test_another_kind_is_refused() -> None:
    with pytest.raises(ValueError, match="'load'"):
        step_curves(IntegratingModel(1.0, 1.0), Settings(0.5), "ramp", np.arange(3.0))
