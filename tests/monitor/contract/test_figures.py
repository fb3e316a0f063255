"""Every figure of health has a meaning."""

from __future__ import annotations

from monitor.contract.figures import MEANINGS, in_units
from monitor.contract.records import LoopRow


def test_every_health_figure_has_a_meaning() -> None:
    """The columns from coverage to compression."""
    names = list(LoopRow.__struct_fields__)
    health = names[names.index("coverage") : names.index("compression") + 1]
    assert sorted(MEANINGS) == sorted(health)


def test_units_of_a_loop_take_the_place_of_pv_and_op() -> None:
    """Words are left alone; a unit that is a quotient is kept together."""
    assert in_units("PV/(OP s)", "bar", "%") == "bar/(% s)"
    assert in_units("OP s/PV", "m3/h", "") == "OP s/(m3/h)"
    assert in_units("% of OP's span, or OP", "bar", "mA") == "% of OP's span, or mA"
    assert in_units("share of time", "bar", "%") == "share of time"
