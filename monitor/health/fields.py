"""What is done to a group of a record's fields at once: sums are halved, what runs is forgotten.

Each health module declares the fields of its record in three groups: ``SUMS`` over the past, which `decay` halves, so
that the recent weeks count most; ``RUNNING``, which `reset` makes zero, since it may not reach across a gap or a change
of mode; ``KEPT``, which neither touches: what is learnt of the loop, and what is set before it is read. Beside these
may stand the records of parts of its own, which the module treats alike.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from monitor.compiled import jit, unrolled


def halving(fields: list[Any]) -> Any:
    """Return a compiled function that halves these fields of a record; whole numbers are rounded down."""
    numbers, arrays = _by_shape(fields)

    @jit
    def halve_numbers(own):
        for name in unrolled(numbers):
            own[name] *= 0.5

    @jit
    def halve(own):
        for name in unrolled(numbers):
            own[name] *= 0.5
        for name in unrolled(arrays):
            _halve(own[name])

    return halve if arrays else halve_numbers


def clearing(fields: list[Any]) -> Any:
    """Return a compiled function that makes these fields of a record zero."""
    numbers, arrays = _by_shape(fields)

    @jit
    def clear_numbers(own):
        for name in unrolled(numbers):
            own[name] = 0

    @jit
    def clear(own):
        for name in unrolled(numbers):
            own[name] = 0
        for name in unrolled(arrays):
            own[name][:] = 0

    return clear if arrays else clear_numbers


@jit
def _halve(values):
    """Halve an array's values."""
    for at in np.ndindex(values.shape):
        values[at] *= 0.5


def _by_shape(fields: list[Any]) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return the names of single numbers and of arrays."""
    return tuple(f[0] for f in fields if len(f) == 2), tuple(f[0] for f in fields if len(f) == 3)
