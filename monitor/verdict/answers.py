"""A loop's answers to steps, where its row has a model: today's, and after the retune that the row suggests."""

from __future__ import annotations

import math

from monitor.advise.answers import answers
from monitor.contract.evidence import Answers
from monitor.contract.records import LoopRow
from tuners.settings import Settings

from .history import LoopHistory
from .joint import joint_of


def answers_of(history: LoopHistory, row: LoopRow) -> tuple[Answers, ...]:
    """Return the responses to unit steps of a loop's model; empty where its row has none, or no settings.

    Parameters
    ----------
    history
        The loop's events, whose model it is.
    row
        As it stands: its new settings are shown, where it has some.
    """
    joint, why = joint_of(history.usable) if history.usable else (None, "")
    if joint is None or why or row.gain is None:
        return ()
    loop, period = history.loop, history.usable[-1].period
    new = None
    if row.new_kp is not None:
        ti = math.inf if row.new_ti is None else row.new_ti
        new = Settings(
            row.new_kp, ti, row.new_td or 0.0, row.new_tf or 0.0, loop.canonical_form, loop.b, loop.c
        )
    return answers(loop, joint, period, new)
