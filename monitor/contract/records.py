"""What goes out: events, assessments, and each loop's row. Plain facts, no behaviour but naming.

Field names and order are the columns of the audit's tables and the keys of the JSON on the wire. A figure that
the data cannot carry is None. Times are integer nanoseconds here and take the reader's form at the edge.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable
from typing import Protocol, TypeVar

import msgspec

from .evidence import Window

GOOD, RETUNE, INCONCLUSIVE, NOT_ASSESSED = "good", "retune", "inconclusive", "not_assessed"
SETPOINT, LOAD, DISTURBANCE = "setpoint", "load", "disturbance"
"""Kinds of event; a disturbance is an upset that is no clean step."""
UNDECIDED = "undecided"
"""Kind of a process of which the data do not tell it."""
WORST_FIRST = (RETUNE, INCONCLUSIVE, GOOD, NOT_ASSESSED)

TIMES = ("start", "end")
"""Fields that hold times [ns since 1970]."""


class OfLoop(Protocol):
    """What is told of one loop."""

    @property
    def loop(self) -> str:
        """The loop's name."""


Told = TypeVar("Told", bound=OfLoop)


def by_loop(records: Iterable[Told]) -> dict[str, list[Told]]:
    """Return what is told of loops by their names, in the order of the records."""
    out: dict[str, list[Told]] = {}
    for one in records:
        out.setdefault(one.loop, []).append(one)
    return out


def event_id(loop: str, onset: int) -> str:
    """Id of the event that the loop's sample at ``onset`` [ns] opened: the same live and in any audit.

    Examples
    --------
    >>> event_id("LIC-101", 1_795_341_600_000_000_000)
    '1cf80f3ad537f012'
    """
    return hashlib.blake2b(f"{loop}\n{onset}".encode(), digest_size=8).hexdigest()


class Event(msgspec.Struct, frozen=True, kw_only=True):
    """An event has opened (``state`` is ``open``) or closed."""

    id: str
    loop: str
    kind: str
    state: str
    start: int
    end: int | None
    amplitude: float
    """Ar [PV] of a set-point step, Ad [OP] of a load step; largest excursion of PV of a disturbance, signed [PV]."""


class Assessment(msgspec.Struct, frozen=True, kw_only=True):
    """One event, judged: a row of ``events.parquet``."""

    loop: str
    id: str
    event: int
    kind: str
    start: int
    end: int
    state: str
    amplitude: float
    iae: float | None = None
    ci: float | None = None
    process: str = UNDECIDED
    gain: float | None = None
    gain_lo: float | None = None
    gain_hi: float | None = None
    t0: float | None = None
    t0_lo: float | None = None
    t0_hi: float | None = None
    dead_time: float | None = None
    dead_time_lo: float | None = None
    dead_time_hi: float | None = None
    lag: float | None = None
    lag_lo: float | None = None
    lag_hi: float | None = None
    method: str | None = None
    fit: float | None = None
    coverage: float | None = None
    verdict: str
    reason: str
    ms: float | None = None
    """Peak sensitivity of the settings then in force on this event's model; inf (null in JSON) where unstable."""
    gain_integrals: float | None = None
    """Gain by the running integrals alone, the fit's independent check."""
    t0_integrals: float | None = None
    """T0 by the running integrals alone [s]."""
    recovery: float | None = None
    """Of a disturbance: from its onset until PV stays where it was [s]; None where that was not seen."""
    overshoot: float | None = None
    """Of a disturbance: largest excursion to the other side, as a share of the amplitude."""
    damping: float | None = None
    """Of a disturbance: of the half waves that follow; None where there are none."""


class LoopRow(msgspec.Struct, frozen=True, kw_only=True):
    """One loop as it stands: a row of ``loops.parquet``."""

    loop: str
    verdict: str = NOT_ASSESSED
    reason: str = ""
    action: str = ""
    events: int = 0
    setpoint_moves: str = ""
    """Moves of the set point, and what became of them, in words; empty where it never moved."""
    ci_setpoint: float | None = None
    ci_load: float | None = None
    ms: float | None = None
    process: str | None = None
    gain: float | None = None
    gain_lo: float | None = None
    gain_hi: float | None = None
    t0: float | None = None
    t0_lo: float | None = None
    t0_hi: float | None = None
    dead_time: float | None = None
    dead_time_lo: float | None = None
    dead_time_hi: float | None = None
    lag: float | None = None
    lag_lo: float | None = None
    lag_hi: float | None = None
    rule: str | None = None
    form: str | None = None
    new_kp: float | None = None
    new_ti: float | None = None
    """Integral time [s]; inf = none (null in JSON)."""
    new_td: float | None = None
    new_tf: float | None = None
    new_ki: float | None = None
    new_kd: float | None = None
    new_fields: str | None = None
    fields: str | None = None
    """Today's settings as the faceplate of the loop's block shows them, JSON; None where that is the form's own."""
    stage_fields: str | None = None
    """The same of each of the stages, JSON."""
    new_ms: float | None = None
    new_ms_worst: float | None = None
    new_ci: float | None = None
    new_op_noise: float | None = None
    new_op_noise_abs: float | None = None
    stages: str | None = None
    coverage: float | None = None
    saturation: float | None = None
    manual: float | None = None
    offset: float | None = None
    noise: float | None = None
    quantum: float | None = None
    travel_per_hour: float | None = None
    reversals_per_hour: float | None = None
    oscillation_period: float | None = None
    oscillation_regularity: float | None = None
    oscillating_share: float | None = None
    """Of the judged time."""
    oscillation_amplitude: float | None = None
    """Of the longest episode [PV]."""
    oscillation_start: float | None = None
    """Of the first episode that is kept, and end of the last [s since 1970]."""
    oscillation_end: float | None = None
    stiction: float | None = None
    dead_band: float | None = None
    """Of the valve [% of OP's span; OP where that is not known]."""
    harris: float | None = None
    compression: float | None = None
    flags: tuple[str, ...] = ()
    kp: float | None = None
    """Settings in force, of the loop table or seen in the data: see ``settings_source``."""
    ti: float | None = None
    td: float | None = None
    tf: float | None = None
    settings_source: str = ""
    """``table``, ``data``; empty where the settings are not known."""
    settings_explained: float | None = None
    """Share of OP's movement that the settings in use explain."""
    kp_seen: float | None = None
    """The controller as the data show it, in the loop's own form (the standard one where that cannot hold it)."""
    kp_seen_lo: float | None = None
    kp_seen_hi: float | None = None
    ti_seen: float | None = None
    """inf = no integral action (null in JSON) [s]."""
    ti_seen_lo: float | None = None
    ti_seen_hi: float | None = None
    td_seen: float | None = None
    td_seen_lo: float | None = None
    td_seen_hi: float | None = None
    pv_filter_seen: float | None = None
    """Time constant of a PV filter inside the block [s]."""
    op_delay_seen: float | None = None
    """By how much OP comes later than its inputs were recorded [s]."""
    scan_seen: float | None = None
    """Execution period of the controller, where it is slower than the samples [s]."""
    disturbances: int = 0
    """Upsets that were seen and are no clean step."""
    overshoot: float | None = None
    """Predicted for today's settings on the model: share of the set-point step."""
    iae_setpoint: float | None = None
    """Predicted, unit step [s]."""
    iae_load: float | None = None
    """Predicted, unit step [PV s/OP]."""
    new_overshoot: float | None = None
    new_iae_setpoint: float | None = None
    new_iae_load: float | None = None
    unit: str = ""
    """Of PV, by the loop table; empty where it names none."""
    op_unit: str = ""
    """Of OP."""


class Spell(msgspec.Struct, frozen=True, kw_only=True):
    """How a loop ran in one of equal spells of time, in automatic: a row of ``spells.parquet``."""

    loop: str
    start: int
    seconds: float
    """That were watched in automatic [s]."""
    error: float
    """Mean size of the error [PV]."""
    error_rms: float
    """Root of its mean square [PV]."""
    op_path: float
    """Way of OP, every move counted [OP/h]."""


class Suggestion(msgspec.Struct, frozen=True, kw_only=True):
    """A loop's row when its verdict is ``retune`` with settings, and the ids of the events it rests on."""

    row: LoopRow
    evidence: tuple[str, ...]


class Plan(msgspec.Struct, frozen=True, kw_only=True):
    """Where a loop's retune leads, and how far it has come."""

    loop: str
    form: str
    """Of the stages' settings."""
    stages: tuple[dict[str, float | None], ...] = ()
    """kp, ti, td, tf of each part, the aim last; ti null for no integral action; empty: there is no plan any more."""
    since: int | None = None
    """When the part that is in force was typed in [ns since 1970]; None while none is."""
    softened: float | None = None
    """Size of the model's error when a small step was taken in spite of it."""


Record = Event | Assessment | Suggestion | Window
