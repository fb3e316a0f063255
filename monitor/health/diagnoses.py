"""All loops' diagnoses, and the blocks that wait: for the loop's next event, or until nothing else waits."""

from __future__ import annotations

from collections.abc import Iterable
from copy import deepcopy

from .diagnosis import Block, Diagnosis, Signs


class Diagnoses:
    """What the loops' blocks showed so far.

    Parameters
    ----------
    most
        Loops whose blocks may wait; of others they are let go. None: any number.
    """

    def __init__(self, most: int | None = None) -> None:
        self.most = most
        self._own: dict[int, Diagnosis] = {}
        self.waiting: dict[int, list[Block]] = {}
        """By row, in order of time."""

    def wait(self, blocks: Iterable[Block]) -> None:
        """Have blocks wait."""
        for block in blocks:
            if self.most is None or block.row in self.waiting or len(self.waiting) < self.most:
                self.waiting.setdefault(block.row, []).append(block)

    def signs(self, row: int) -> Signs:
        """Return what a loop's blocks have shown, those that wait left out."""
        own = self._own.get(row)
        return Signs() if own is None else own.signs()

    def catch_up(self, row: int, until: int | None = None) -> Block | None:
        """Look at a loop's blocks that end by ``until`` [ns], all by default; return the last one if it goes on."""
        waiting, so_far = self.waiting.pop(row, []), None
        if not waiting:
            return None
        own = self._own.setdefault(row, Diagnosis())
        for k, block in enumerate(waiting):
            if until is not None and block.end > until:
                self.waiting[row] = waiting[k:]
                break
            so_far = block if block.so_far else None
            if so_far is None:
                own.add(block)
        return so_far

    def look(self, row: int, until: int | None = None) -> Signs:
        """Look at a loop's blocks that end by ``until`` [ns], all by default; return what all show up to then.

        Of a loop's first block it is looked at what there is of it, which is not kept: it comes again when it is full.
        """
        so_far, own = self.catch_up(row, until), self._own.get(row)
        if so_far is None or own is None or until is None or own.judged > 0.0:
            return self.signs(row)
        own = deepcopy(own)
        own.add(so_far)
        return own.signs()

    def of(self, row: int) -> Diagnosis | None:
        """Return what a loop's blocks have shown; None where they have shown nothing."""
        return self._own.get(row)

    def go_on(self, row: int, diagnosis: Diagnosis | None) -> None:
        """Go on with what a loop's blocks have shown before; None where they had shown nothing."""
        if diagnosis is not None:
            self._own[row] = diagnosis

    def forget(self, row: int) -> None:
        """Forget a loop: its row is another's, or it has been re-tuned."""
        self._own.pop(row, None)
        self.waiting.pop(row, None)
