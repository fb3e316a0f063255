"""What is published for the eye: new samples of flagged loops, and of loops with an open event."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from monitor.contract import keys
from monitor.contract.samples import Samples
from monitor.engine import Engine
from monitor.wire.arrow import encode_trend
from monitor.wire.encode import FRAME_MIME

from .bus import Bus
from .every import Every
from .shelf import Shelf

WATCH_EVERY_S = 0.2
"""Between two looks at all loops, for those worth a trend [s]."""
TREND_EVERY_S = 1.0
"""[s]"""
TREND_LOOPS = 50
"""Of each kind, flagged or open, whose samples are published."""


class Trends:
    """Publishes trends, about once a second.

    Parameters
    ----------
    engine
        Knows which loops have an open event.
    shelf
        Knows whose flags are put aside.
    """

    def __init__(self, engine: Engine, bus: Bus, shelf: Shelf) -> None:
        self._shelf = shelf
        self._flagged: set[int] = set()
        self._engine, self._loops, self._bus = engine, engine.loops, bus
        self._held: list[Samples] = []
        self._watched = np.zeros(0, np.bool_)
        self._watch, self._publish = Every(WATCH_EVERY_S), Every(TREND_EVERY_S)

    @property
    def flagged(self) -> set[int]:
        """Loops that somebody has to see to, and has not put aside: near instability, with a fault, to be re-tuned."""
        return self._flagged - self._shelf.rows

    def flag(self, row: int, flagged: bool) -> None:
        """Show a loop from now on, or no more."""
        (self._flagged.add if flagged else self._flagged.discard)(row)

    def take(self, batches: Iterable[Samples], now: float) -> None:
        """Keep new samples of the loops shown, and publish what there is when it is time; ``now`` [s, monotonic]."""
        if len(self._watched) < len(self._loops):
            self._watch.hasten(now)
        if self._watch.due(now):
            self._watched = np.zeros(len(self._loops), np.bool_)
            self._watched[sorted(self.flagged)[:TREND_LOOPS]] = True
            self._watched[self._engine.open_rows()[:TREND_LOOPS]] = True
        self._held += [b.take(self._watched[b.loop]) for b in batches]
        if not self._publish.due(now):
            return
        held, self._held = [b for b in self._held if len(b)], []
        if not held:
            return
        loops = np.concatenate([b.loop for b in held])
        columns = {n: np.concatenate([getattr(b, n) for b in held]) for n in ("time", "sp", "pv", "op")}
        for row in np.unique(loops).tolist():
            own = {n: c[loops == row] for n, c in columns.items()}
            loop, time = self._loops[row], own.pop("time")
            self._bus.publish(keys.trend(loop.key), encode_trend(loop.name, time, own), FRAME_MIME)
