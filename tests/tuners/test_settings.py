"""PID forms: what converts, what cannot, and that the controller stays the same."""

import math

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from tuners.settings import NotRepresentableError, Settings

OMEGA = np.geomspace(1e-3, 1e3, 60)
gains = st.floats(0.01, 100).flatmap(lambda k: st.sampled_from([k, -k]))
series = st.builds(
    lambda kp, ti, share, n, b, c: Settings(kp, ti, share * ti, share * ti / n, "series", b, c),
    gains, st.floats(0.1, 1e4), st.floats(0.01, 0.95), st.floats(2, 50),
    st.sampled_from([0.0, 0.5, 1.0]), st.sampled_from([0.0, 1.0]),
)  # fmt: skip


@pytest.mark.parametrize("form", ["standard", "parallel"])
def test_series_to_standard_without_filter_is_the_known_formula(form):
    """f = 1 + Td/Ti: Kc = Ks f, Ti = Tis f, Td = Tds/f."""
    converted = Settings(2.0, 30.0, 6.0, form="series").to(form)
    f = 1 + 6 / 30
    assert (converted.kp, converted.ti, converted.td) == pytest.approx((2 * f, 30 * f, 6 / f), rel=1e-14)


def test_standard_to_series_without_filter_is_the_known_formula():
    converted = Settings(2.0, 30.0, 6.0).to("series")
    q = math.sqrt(1 - 4 * 6 / 30)
    expected = (2 * (1 + q) / 2, 30 * (1 + q) / 2, 30 * (1 - q) / 2)
    assert (converted.kp, converted.ti, converted.td) == pytest.approx(expected, rel=1e-12)


@given(series)
def test_conversion_keeps_the_controller(settings):
    """Feedback and set-point path of both forms are the same function of frequency."""
    assume(settings.b > 0 or settings.c == 0)
    for form in ("standard", "parallel"):
        other = settings.to(form)
        np.testing.assert_allclose(
            other.frequency_response(OMEGA), settings.frequency_response(OMEGA), rtol=1e-9
        )
        np.testing.assert_allclose(
            other.setpoint_response(OMEGA), settings.setpoint_response(OMEGA), rtol=1e-9
        )


@given(series)
def test_round_trip(settings):
    assume(settings.b == 1)
    back = settings.to("standard").to("series")
    for name in ("kp", "ti", "td", "tf", "b", "c"):
        # The double root ti = 4 td of the standard form halves the digits: td/ti stays below 0.95 above.
        assert getattr(back, name) == pytest.approx(getattr(settings, name), rel=1e-9, abs=1e-9)


@pytest.mark.parametrize("name", ["kp", "ti", "td", "tf"])
def test_round_trip_to_twelve_digits(name):
    settings = Settings(-0.7, 40.0, 7.0, 0.7, "series")
    assert getattr(settings.to("standard").to("series"), name) == pytest.approx(
        getattr(settings, name), rel=1e-12
    )


@pytest.mark.parametrize("form", ["standard", "parallel", "series"])
@pytest.mark.parametrize("ti", [math.inf, 20.0])
def test_p_and_pi_are_the_same_in_every_form(form, ti):
    converted = Settings(1.5, ti, tf=3.0).to(form)
    assert (converted.kp, converted.ti, converted.td) == (1.5, ti, 0.0)


def test_pd_converts_without_integral():
    settings = Settings(2.0, math.inf, 5.0, 0.5, "series")
    standard = settings.to("standard")
    assert (standard.kp, standard.ti, standard.td) == pytest.approx((2.0, math.inf, 4.5))
    np.testing.assert_allclose(standard.frequency_response(OMEGA), settings.frequency_response(OMEGA))


@pytest.mark.parametrize("td", [0.26, 1.0])
def test_standard_with_short_integral_has_no_series_form(td):
    with pytest.raises(NotRepresentableError, match="ti must be at least 4 td"):
        Settings(1.0, 1.0, td).to("series")


def test_double_root_is_representable():
    assert Settings(1.0, 4.0, 1.0).to("series").ti == pytest.approx(2.0)


def test_least_ratio_in_the_message_is_the_limit():
    """With a filter the limit is a little above 4; the message names it exactly."""
    with pytest.raises(NotRepresentableError, match=r"at least 4\.198 td") as error:
        Settings(1.0, 4.0, 1.0, 0.1).to("series")
    limit = float(str(error.value).split()[5])
    assert Settings(1.0, limit * 1.005, 1.0, 0.1).to("series").td > 0
    with pytest.raises(NotRepresentableError):
        Settings(1.0, limit * 0.99, 1.0, 0.1).to("series")


def test_series_lag_has_no_standard_form():
    with pytest.raises(NotRepresentableError, match="lag"):
        Settings(1.0, 10.0, 1.0, 2.0, "series").to("standard")


def test_weights_that_the_series_form_lacks_are_refused():
    with pytest.raises(NotRepresentableError, match="weights"):
        Settings(1.0, 40.0, 5.0, 0.5, b=0.0, c=1.0).to("series")


def test_parallel_gains_and_the_wrong_web_formula():
    """Ti = Kp/Ki and Td = Kd/Kp; a widely copied page says Ti = 1/Ki, Td = Kd."""
    settings = Settings(4.0, 20.0, 3.0, form="parallel")
    assert (settings.ki, settings.kd) == (0.2, 12.0)
    assert settings.kp / settings.ki == settings.ti != 1 / settings.ki
    assert settings.kd / settings.kp == settings.td != settings.kd
    s = 1j * OMEGA
    np.testing.assert_allclose(settings.frequency_response(OMEGA), 4 + 0.2 / s + 12 * s)


def test_arrays_convert_elementwise():
    many = Settings(
        np.array([1.0, -2.0, 3.0]), np.array([30.0, math.inf, 50.0]), np.array([2.0, 3.0, 0.0]), 0.2, "series"
    )
    converted = many.to("standard")
    for i in range(3):
        one = Settings(*(float(v[i]) for v in (many.kp, many.ti, many.td)), 0.2, "series").to("standard")
        assert (converted.kp[i], converted.ti[i], converted.td[i]) == pytest.approx((one.kp, one.ti, one.td))


def test_nan_stays_nan():
    converted = Settings(np.array([1.0, np.nan]), np.array([30.0, np.nan]), np.array([2.0, np.nan])).to(
        "series"
    )
    assert np.isnan(converted.kp).tolist() == [False, True]


@pytest.mark.parametrize(
    ("kwargs", "field"),
    [
        ({"form": "ideal"}, "form"),
        ({"ti": 0.0}, "ti"),
        ({"ti": -3.0}, "ti"),
        ({"td": -1.0}, "td"),
        ({"tf": math.inf}, "tf"),
        ({"kp": math.inf}, "kp"),
    ],
)
def test_wrong_settings_name_the_field(kwargs, field):
    with pytest.raises(ValueError, match=field):
        Settings(**({"kp": 1.0} | kwargs))


def test_unknown_target_form():
    with pytest.raises(ValueError, match="standard, series, parallel"):
        Settings(1.0).to("ideal")
