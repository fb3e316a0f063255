"""Keys are spelled as the contract's table spells them."""

from __future__ import annotations

import pytest

from monitor.contract import keys

LOOP = "plant/LIC-101"


@pytest.mark.parametrize(
    ("key", "spelled"),
    [
        (keys.event(LOOP), "loopsight/plant/LIC-101/event"),
        (keys.assessment(LOOP), "loopsight/plant/LIC-101/assessment"),
        (keys.suggestion(LOOP), "loopsight/plant/LIC-101/suggestion"),
        (keys.trend(LOOP), "loopsight/plant/LIC-101/trend"),
        (keys.status("**"), "loopsight/**/status"),
        (keys.window(LOOP), "loopsight/plant/LIC-101/window"),
        (keys.window("**", "1f"), "loopsight/**/window/1f"),
        (keys.history(LOOP, "1f"), "loopsight/plant/LIC-101/history/1f"),
        (keys.monitor_status("*"), "loopsight/@/*/status"),
        (keys.monitor_alive("demo"), "loopsight/@/demo/alive"),
    ],
)
def test_as_in_the_contract(key, spelled):
    assert key == spelled
