"""How each loop ran in equal spells of time: the size of its error, the way of its OP.

The scatter between spells tells what a mean over the whole record is worth. Memory stays bounded: where a record is
longer than `MOST_SPELLS`, they become twice as long.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from monitor.compiled import jit
from monitor.contract.records import Spell
from monitor.contract.samples import QUALITY_UNCERTAIN, Samples

MOST_SPELLS = 32
"""Of a loop; of a record of some length 17 to 32: enough for their scatter, and each far longer than a response."""
FIRST_SPELL_S = 600.0
"""At first."""
MOST_HELD_S = 600.0
"""For which a sample stands at most: a longer gap is no time that was watched."""
LEAST_SHARE = 0.5
"""Of a spell that must have been watched in automatic: the ends, and what was in manual, say less."""
_SECONDS, _ERROR, _SQUARE, _PATH = range(4)


class Spells:
    """Takes samples as they come, and sums each loop's spells.

    Parameters
    ----------
    names
        Of the loops, by row.
    """

    def __init__(self, names: Sequence[str]) -> None:
        n = len(names)
        self.names = names
        self._sums = np.zeros((n, MOST_SPELLS, 4))
        """(L, `MOST_SPELLS`, 4): time watched [s], integrals of the error's size and square, way of OP."""
        self._width = np.full(n, int(FIRST_SPELL_S * 1e9), np.int64)
        """(L,) length of a spell [ns]."""
        self._first = np.full(n, np.iinfo(np.int64).min, np.int64)
        """(L,) number of the first spell since 1970."""
        self._place = np.zeros(n, np.int64)
        self._until = np.full(n, np.iinfo(np.int64).min, np.int64)
        """(L,) place and end of the spell that fills [ns since 1970]."""
        self._last_time = np.zeros(n, np.int64)
        self._last = np.full((n, 2), np.nan)
        """(L, 2) error and OP of the last sample; NaN where it does not count."""

    def take(self, samples: Samples) -> None:
        """Take in a batch, each loop's times increasing."""
        spell = self._sums, self._width, self._first, self._place, self._until
        _take(samples.columns(), spell, self._last_time, self._last)

    def found(self) -> list[Spell]:
        """Return the spells that were watched for long enough, by loop, then by time."""
        out = []
        for row, name in enumerate(self.names):
            width, first = int(self._width[row]), int(self._first[row])
            for k in np.flatnonzero(self._sums[row, :, _SECONDS] >= LEAST_SHARE * width * 1e-9).tolist():
                seconds, error, square, path = self._sums[row, k].tolist()
                rms = (square / seconds) ** 0.5
                out.append(
                    Spell(
                        loop=name,
                        start=(first + k) * width,
                        seconds=seconds,
                        error=error / seconds,
                        error_rms=rms,
                        op_path=path / seconds * 3600.0,
                    )
                )
        return out


@jit
def _take(columns, spell, last_time, last):
    """Sum samples into their loops' spells; each stands until the next (compiled)."""
    sums, _, _, place, until = spell
    for k in range(len(columns.time)):
        i, time = columns.loop[k], columns.time[k]
        dt = (time - last_time[i]) * 1e-9
        e = columns.sp[k] - columns.pv[k]
        if not columns.auto[k] or columns.quality[k] < QUALITY_UNCERTAIN:
            e = np.nan
        before = last[i, 0]
        if 0.0 < dt <= MOST_HELD_S and not np.isnan(before):
            if last_time[i] >= until[i]:
                _next(spell, i, last_time[i])
            at = sums[i, place[i]]
            at[_SECONDS] += dt
            at[_ERROR] += dt * abs(before)
            at[_SQUARE] += dt * before * before
            move = abs(columns.op[k] - last[i, 1])
            if not np.isnan(e) and not np.isnan(move):
                at[_PATH] += move
        last_time[i], last[i, 0], last[i, 1] = time, e, columns.op[k]


@jit
def _next(spell, i, time):
    """Go on to the spell of a time; spells are joined, two and two, where it is too far on."""
    sums, width, first, place, until = spell
    if first[i] == np.iinfo(np.int64).min:
        first[i] = time // width[i]
    while time // width[i] - first[i] >= MOST_SPELLS:
        half = first[i] // 2
        for k in range(MOST_SPELLS):
            to = (first[i] + k) // 2 - half
            for j in range(4):
                value = sums[i, k, j]
                sums[i, k, j] = 0.0
                sums[i, to, j] += value
        first[i], width[i] = half, 2 * width[i]
    place[i] = time // width[i] - first[i]
    until[i] = (time // width[i] + 1) * width[i]
