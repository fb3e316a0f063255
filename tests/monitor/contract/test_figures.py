"""Every figure of health has a meaning."""

from __future__ import annotations

from monitor.contract.figures import MEANINGS
from monitor.contract.records import LoopRow


def test_every_health_figure_has_a_meaning() -> None:
    """The columns from coverage to compression."""
    names = list(LoopRow.__struct_fields__)
    health = names[names.index("coverage") : names.index("compression") + 1]
    assert sorted(MEANINGS) == sorted(health)
