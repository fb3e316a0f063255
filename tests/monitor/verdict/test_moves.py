"""The set point's moves, accounted for in words."""

from __future__ import annotations

from monitor.detect.state import FATES
from monitor.verdict.moves import SAID, moves_in_words


def test_every_fate_has_its_words():
    assert set(SAID) == set(FATES)


def test_moves_add_up():
    fates = dict.fromkeys(FATES, 0) | {"recorded": 3, "in_noise": 6}
    assert moves_in_words(fates) == "9 moves: 3 with an event of their own, 6 below the noise"
    assert moves_in_words(dict.fromkeys(FATES, 0)) == ""
    assert moves_in_words(dict.fromkeys(FATES, 0) | {"in_manual": 1}) == "1 move: 1 in manual"
