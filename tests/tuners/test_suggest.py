"""Settings by rules for one model, as rows."""

from __future__ import annotations

import pytest

from tuners.models import IntegratingModel, SelfRegulatingModel
from tuners.relay import relay_ifopdt
from tuners.rules import RULES
from tuners.suggest import SORTABLE, model_of, model_of_relay, suggest

LEVEL = IntegratingModel(0.05, 4.0, 3.0)


def test_all_rules_that_serve_and_why_the_others_do_not():
    found = suggest("all", LEVEL)
    assert {row["rule"] for row in found.rows} == set(found.responses)
    assert set(found.responses) | set(found.skipped) == set(RULES)
    assert found.skipped["cohen-coon"].startswith("process = integrating: this rule is for self-regulating")


@pytest.mark.parametrize("column", [c for c in SORTABLE if c != "rule"])
def test_sorted_by_any_column_what_is_unknown_last(column):
    values = [row[column] for row in suggest("all", LEVEL, sort=column).rows]
    known = [v for v in values if v is not None]
    assert values == sorted(known) + [None] * (len(values) - len(known))


def test_one_rule_that_does_not_serve_is_an_error():
    with pytest.raises(ValueError, match="max-load, max-deviation: must be given for this rule"):
        suggest("averaging", LEVEL)
    with pytest.raises(ValueError, match="give one of them, a block has its own form"):
        suggest("simc-pi", LEVEL, form="series", block="deltav-pid")


def test_models_of_a_users_numbers():
    assert model_of("integrating", -0.05, 4.0, 3.0) == IntegratingModel(-0.05, 4.0, 3.0)
    assert model_of("self-regulating", 2.0, 1.0, 5.0, 2.0) == SelfRegulatingModel(2.0, 1.0, 5.0, 2.0)
    for wrong, names in (
        (("integrating", None, 4.0), "gain = None: must be given"),
        (("integrating", 1.0, float("inf")), "dead-time = inf: must be a finite number"),
        (("integrating", 1.0, 4.0, 0.0, 2.0), "lag2 = 2: is for self-regulating processes"),
        (("batch", 1.0, 4.0), "process = 'batch'"),
    ):
        with pytest.raises(ValueError, match=names):
            model_of(*wrong)


def test_a_relay_test_shows_the_lag_where_the_gain_is_known():
    assert model_of_relay(2.0, 16.0, 0.4) == IntegratingModel(0.05, 4.0)
    assert model_of_relay(1.0, 15.9446, 3.2933, gain=-1.0) == relay_ifopdt(-1.0, 1.0, 15.9446, 3.2933)
    with pytest.raises(ValueError, match="relay-amplitude = None: must be given"):
        model_of_relay(1.0, 16.0, None)
    with pytest.raises(ValueError, match="gain = 0"):
        model_of_relay(1.0, 16.0, 0.2, gain=0.0)
