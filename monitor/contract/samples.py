"""What comes in: columns of samples. The only form in which data reaches the engine."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields
from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
"""Numbers of any shape."""

Picked = NDArray[np.bool_] | NDArray[np.intp] | NDArray[np.int32] | Sequence[int] | slice
"""Which rows: a mask, their numbers, or a slice."""
Scalar = TypeVar("Scalar", bound=np.generic)

QUALITY_GOOD = 192
"""OPC quality from which a sample counts as good."""
QUALITY_UNCERTAIN = 64
"""OPC quality from which a sample is used, but counted as uncertain; below it is bad."""


class Columns(NamedTuple):
    """The columns of N samples as compiled functions take and give them; see `Samples`."""

    loop: NDArray[np.int32]
    time: NDArray[np.int64]
    sp: Array
    pv: Array
    op: Array
    auto: NDArray[np.bool_]
    quality: NDArray[np.uint8]


@dataclass(frozen=True, eq=False, slots=True)
class Samples:
    """N samples of any number of loops; each loop's own times increase strictly.

    Missing values are NaN. ``time`` is in integer nanoseconds since 1970 (UTC), because a float of
    epoch seconds cannot hold a microsecond and live and audit must see the same instants.
    """

    loop: NDArray[np.int32]
    """(N,) row of the loop table."""
    time: NDArray[np.int64]
    """(N,) [ns] since 1970-01-01 UTC."""
    sp: NDArray[np.float64]
    """(N,) set point [PV]."""
    pv: NDArray[np.float64]
    """(N,) process variable [PV]."""
    op: NDArray[np.float64]
    """(N,) controller output, held until the loop's next sample [OP]."""
    auto: NDArray[np.bool_]
    """(N,) False where the loop is in manual."""
    quality: NDArray[np.uint8]
    """(N,) OPC quality code; 192 and above is good, below 64 bad."""

    def __len__(self) -> int:
        return len(self.time)

    def take(self, rows: Picked) -> Samples:
        """Return the samples of these rows (index array, mask or slice)."""
        return Samples(*(getattr(self, f.name)[rows] for f in fields(self)))

    def by_loop(self) -> Iterator[tuple[int, Samples]]:
        """Yield the samples of each loop, in their order, beside its row of the loop table."""
        order = np.argsort(self.loop, kind="stable")
        codes, starts = np.unique(self.loop[order], return_index=True)
        for code, rows in zip(codes.tolist(), np.split(order, starts[1:]), strict=True):
            yield code, self.take(rows)

    def columns(self) -> Columns:
        """Return the columns, not copied."""
        return Columns(*(getattr(self, name) for name in Columns._fields))

    @classmethod
    def of(
        cls,
        loop: ArrayLike,
        time: ArrayLike,
        sp: ArrayLike,
        pv: ArrayLike,
        op: ArrayLike,
        auto: ArrayLike | None = None,
        quality: ArrayLike | None = None,
    ) -> Samples:
        """Make samples of anything array-like; a scalar ``loop`` stands for all rows.

        Raises
        ------
        ValueError
            A column's length differs from that of ``time``.

        Examples
        --------
        >>> second = 10**9
        >>> samples = Samples.of(loop=0, time=[0, second], sp=50.0, pv=[49.9, 50.1], op=30.0)
        >>> len(samples), samples.sp, samples.auto
        (2, array([50., 50.]), array([ True,  True]))
        """
        t = np.ascontiguousarray(time, dtype=np.int64)
        n = len(t)

        def column(name: str, values: ArrayLike, dtype: type[Scalar]) -> NDArray[Scalar]:
            if (
                np.ndim(values) == 0
            ):  # an array of its own: one that cannot be written is another type to the kernel
                return np.full(n, values, dtype=dtype)
            out = np.ascontiguousarray(values, dtype=dtype)
            if out.shape != (n,):
                raise ValueError(f"samples: column {name} has shape {out.shape}, expected ({n},)")
            return out

        return cls(
            column("loop", loop, np.int32),
            t,
            column("sp", sp, np.float64),
            column("pv", pv, np.float64),
            column("op", op, np.float64),
            column("auto", True if auto is None else auto, np.bool_),
            column("quality", QUALITY_GOOD if quality is None else quality, np.uint8),
        )
