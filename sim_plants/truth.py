"""What is true of simulated loops, in the columns of the loop table and of the truth files."""

import math
from collections.abc import Sequence
from typing import Any

from sim_plants.specs import LoopSpec

TRUTH_COLUMNS = ("loop", "process", "gain", "t0", "dead_time", "lag", "tuning")
EVENT_COLUMNS = ("loop", "kind", "onset", "amplitude")


def _known(value: float | None) -> float | None:
    """Return a finite number, None for what is not known or has no limit."""
    return value if value is not None and math.isfinite(value) else None


def loop_table(loops: Sequence[LoopSpec]) -> list[dict[str, Any]]:
    """Return a row of the loop table for each loop, with its true settings; None where a cell is empty.

    The form `parallel` is given by `ki` [OP/(PV s)] and `kd` [OP s/PV], the others by `ti` and `td` [s],
    `inf` without integral action.
    """
    rows = []
    for loop in loops:
        pid = loop.controller
        parallel = pid.form == "parallel"
        rows.append(
            {
                "name": loop.name,
                "process": loop.plant.process,
                "objective": loop.objective,
                "controller": pid.structure,
                "allow_pd": loop.allow_pd,
                "form": pid.form,
                "b": pid.b,
                "c": pid.c,
                "kp": pid.kp,
                "ti": None if parallel else pid.ti,
                "td": None if parallel else pid.td,
                "ki": pid.kp / pid.ti if parallel else None,
                "kd": pid.kp * pid.td if parallel else None,
                "tf": pid.filter_time if pid.td > 0 else None,
                "pv_low": _known(loop.pv_low),
                "pv_high": _known(loop.pv_high),
                "op_low": _known(pid.op_low),
                "op_high": _known(pid.op_high),
                "closed_loop_time": loop.closed_loop_time,
                "max_load": loop.max_load,
                "max_deviation": loop.max_deviation,
                "period": loop.true_period,
            }
        )
    return rows


def truth_rows(loops: Sequence[LoopSpec]) -> list[dict[str, Any]]:
    """Return, for each loop: process, gain [PV/(OP s)] or [PV/OP], t0, dead time and lag [s], tuning.

    `t0` is the sum of the true lags and dead time, `dead_time` and `lag` follow from the half rule.
    """
    rows = []
    for loop in loops:
        dead_time, lag = loop.plant.half_rule()
        values = (loop.name, loop.plant.process, loop.plant.gain, loop.plant.t0, dead_time, lag, loop.tuning)
        rows.append(dict(zip(TRUTH_COLUMNS, values, strict=True)))
    return rows


def truth_events(loops: Sequence[LoopSpec], until: float, start: float = 0.0) -> list[dict[str, Any]]:
    """Return the steps before `until` in the order of time.

    Parameters
    ----------
    loops : sequence of LoopSpec
        The loops.
    until : float
        End, since the start of the simulation [s].
    start : float
        Time of the start, added to each onset [s].

    Returns
    -------
    list of dict
        `loop`, `kind` (`setpoint` or `load`), `onset` [s] and `amplitude` ([PV], [OP]). A set-point step has
        its onset at the sample that shows it first, a load step when it enters the process, which its dead
        time precedes. Set-point steps in manual count as well.
    """
    rows = []
    for loop in loops:
        for kind, schedule in (("setpoint", loop.setpoint), ("load", loop.load)):
            for time, size in schedule.until(until):
                onset = loop.sample_at(time) * loop.true_period if kind == "setpoint" else time
                rows.append(dict(zip(EVENT_COLUMNS, (loop.name, kind, start + onset, size), strict=True)))
    return sorted(rows, key=lambda row: (row["onset"], row["loop"], row["kind"]))
