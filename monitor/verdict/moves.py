"""What became of a set point's moves, in words: none is passed over in silence."""

from __future__ import annotations

from collections.abc import Mapping

SAID = {
    "recorded": "with an event of their own",
    "in_noise": "below the noise",
    "beside": "beside a far larger one, in its event",
    "in_manual": "in manual",
    "cut_off": "across a gap, or where the data begin",
    "unrecorded": "of a set point that goes on moving, between its recorded stretches",
}
"""Of each fate (`detect.state.FATES`)."""


LED_MOVES, LED_SHARE = 50, 0.8
"""Moves, and the share of them that go on and on, from which somebody else moves the set point: a master."""


def is_led(fates: Mapping[str, int]) -> bool:
    """Whether a set point moves all the time, by the fates of its moves (as in `moves_in_words`)."""
    total = sum(fates.values())
    return total >= LED_MOVES and fates["unrecorded"] >= LED_SHARE * total


def moves_in_words(fates: Mapping[str, int]) -> str:
    """Say how many moves there were, and what became of them: "9 moves: 6 below the noise, 3 in manual".

    Parameters
    ----------
    fates
        Moves of the set point, by `SAID`; a ramp is one move.
    """
    total = sum(fates.values())
    if total == 0:
        return ""
    parts = ", ".join(f"{fates[name]:,} {said}" for name, said in SAID.items() if fates[name])
    return f"{total:,} move{'' if total == 1 else 's'}: {parts}"
