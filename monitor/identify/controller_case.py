"""A question to the data: rows, a loop and a law; and how the answer is put."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from monitor.contract.loops import Loop
from monitor.contract.samples import Array
from tuners.settings import Settings

from .controller_fit import Estimate, Known, Place
from .controller_rows import Rows
from .controller_seen import AS_DECLARED, BESIDE, UNRESOLVED, Controller, intervals

FORGETS_LN = 9.0
"""Of the share to which the derivative filter's unknown start fades, until its rows count."""
NOWHERE = Place(0.0, 0.0, 0.0)
FREE = np.full(4, np.nan)


@dataclass(frozen=True, eq=False, slots=True)
class Case:
    """Rows, as recorded and at which the controller ran, and the law that is asked for."""

    rows: Rows
    recorded: Rows
    loop: Loop
    known: Known
    late: int = 0
    """Rows as recorded by which OP follows its inputs, within a run of a slow controller."""

    def settled(self) -> Case:
        """Return the case without the first rows, in which the derivative's unknown start is seen."""
        if not self.known.derivative:
            return self
        use = self.rows.use.copy()
        period, tf = self.rows.period, self.known.tf
        fading = FORGETS_LN / math.log1p(period / tf) if tf > 0 else 0.0
        use[: min(2 + math.ceil(fading), len(use) // 4)] = False
        return replace(self, rows=replace(self.rows, use=use))

    def controller(
        self, said: str, found: Estimate | None, place: Place, share: float, cause: str = ""
    ) -> Controller:
        """Return what is said, of settings as found or, without, of the table's."""
        exact = Estimate.exact(self.known.gains) if found is None else found
        kp, ti, td = intervals(exact)
        if said in {AS_DECLARED, BESIDE}:  # what the discretisation may shift is no difference
            exact = Estimate.exact(self.known.gains)
            kp, ti, td = (i.including(o) for i, o in zip((kp, ti, td), intervals(exact), strict=True))
        return Controller(
            said=said,
            settings=None if said == UNRESOLVED else settings_of_gains(exact.gains, self.known),
            kp=kp,
            ti=ti,
            td=td,
            explained=min(max(share, 0.0), 1.0),
            pv_filter=place.filter_time,
            op_delay=place.late * self.rows.period + self.late * self.recorded.period,
            scan=self.rows.period if self.rows.stride == 1 else self.rows.period / self.rows.stride,
            period=self.recorded.period / self.recorded.stride,
            cause=cause,
        )


def settings_of_gains(gains: Array, known: Known) -> Settings | None:
    """Return gains as settings in standard form, with the filter and weights of the law; None where they are none."""
    kp, ki, kd = (float(g) for g in gains[:3])
    if kp == 0 or ki / kp < 0:
        return None
    td = max(kd / kp, 0.0)
    return Settings(
        kp, kp / ki if ki else math.inf, td, known.tf if td > 0 else 0.0, "standard", known.b, known.c
    )
