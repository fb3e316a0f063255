"""What is known of a loop, as bytes and back: the next process goes on with it as if it had never ended.

Facts of known kinds only: numbers, text, arrays, and the records of the stations. Nothing that is read can name code.
What another version wrote, whose records have other fields, is not read.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, field, fields, is_dataclass
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from monitor.advise.prediction import Predicted
from monitor.advise.suggestion import Advice
from monitor.assess.event import Finding
from monitor.contract.loops import Loop
from monitor.contract.records import Assessment, LoopRow, Plan
from monitor.detect.event import ClosedEvent, EventWindow
from monitor.detect.state import STATE
from monitor.health.cycle_gain import CycleGain
from monitor.health.diagnosis import Diagnosis
from monitor.health.episodes import Episodes, LoopSpan
from monitor.health.observe import HEALTH
from monitor.health.response import NoResponse
from monitor.health.tracking import Tracked
from monitor.health.valve import ValveEvidence
from monitor.identify.controller_seen import Controller, Interval
from monitor.identify.fit import Fit, Load, Valley, Wander
from monitor.identify.misfit import ModelError, OpenModes
from monitor.reporting.state import REPORTING, ROW
from monitor.verdict.history import LoopHistory, Standing
from monitor.verdict.in_force import Change, InForce
from monitor.verdict.parts import Suggested, Tuning
from tuners.settings import Settings


@dataclass(frozen=True, slots=True, eq=False)
class LoopMemory:
    """All that samples have shown of a loop, but for those of its last minutes."""

    history: LoopHistory | None
    """What its events showed; None where there were none."""
    diagnosis: Diagnosis | None
    """What its blocks showed; None where there were none."""
    numbers: dict[str, NDArray[Any]]
    """Its row of each array of running numbers."""
    tags: dict[str, float | int] = field(default_factory=dict)
    """SP, OP and mode that hold until others come, and since when [ns since 1970]."""


@dataclass(frozen=True, slots=True, eq=False)
class WaitingEvent:
    """An event that has closed and is to be assessed, with what was known of its loop's rows then."""

    id: str
    """The event's, as it is told."""
    event: ClosedEvent
    dead_band: float | None
    """By which PV must change for a row to come, about [PV]; None where rows come at a rate."""


_KINDS: dict[str, type] = {
    kind.__name__: kind
    for kind in (
        *(LoopMemory, WaitingEvent, Loop, LoopHistory, InForce, Change, Controller, Interval, Settings),
        *(Finding, Assessment, Fit, Valley, Load, Wander, ModelError, OpenModes, Tuning, Suggested, Standing),
        *(Advice, Predicted, Plan, LoopRow, ClosedEvent, EventWindow),
        *(Diagnosis, Episodes, LoopSpan, ValveEvidence, NoResponse, Tracked, CycleGain),
    )
}
_DTYPES = {"state": STATE, "health": HEALTH, "reporting": REPORTING, "row": ROW}
_KIND = ""
"""Key under which a map says of which kind it is."""


def _names(kind: type) -> tuple[str, ...]:
    """Return the fields of a kind, in order; what is worked out from others is none that a value is made of."""
    if is_dataclass(kind):
        return tuple(f.name for f in fields(kind) if f.init)
    return tuple(getattr(kind, "_fields", ()) or getattr(kind, "__struct_fields__", ()))


_FIELDS = {name: _names(kind) for name, kind in _KINDS.items()}
LAYOUT = hashlib.blake2b(
    repr([sorted(_FIELDS.items()), [(n, d.descr) for n, d in _DTYPES.items()]]).encode(), digest_size=8
).hexdigest()
"""Names what the bytes hold: another version's, with other fields, has another."""


def encode(known: LoopMemory | WaitingEvent) -> bytes:
    """Return what is known as bytes (MessagePack).

    Raises
    ------
    TypeError
        Something in it is of no known kind.
    """
    return msgspec.msgpack.encode(_plain(known))


def decode(payload: bytes) -> LoopMemory | WaitingEvent:
    """Read what `encode` wrote.

    Raises
    ------
    ValueError
        It is damaged, or something else.
    """
    try:
        known = _back(msgspec.msgpack.decode(payload))
    except (msgspec.MsgspecError, KeyError, TypeError, ValueError, AttributeError) as error:
        raise ValueError(f"not what was remembered of a loop: {error}") from None
    if not isinstance(known, (LoopMemory, WaitingEvent)):
        raise ValueError("not what was remembered of a loop")  # noqa: TRY004 (one kind of error for one bad payload)
    return known


def _plain(value: Any) -> Any:
    """Return a value as maps, lists, numbers, text and bytes."""
    kind = type(value)
    out: Any = value
    if _KINDS.get(kind.__name__) is kind:
        own = {name: _plain(getattr(value, name)) for name in _FIELDS[kind.__name__]}
        out = {_KIND: kind.__name__, **own}
    elif kind is tuple:
        out = {_KIND: "tuple", "of": [_plain(v) for v in value]}
    elif kind is list:
        out = [_plain(v) for v in value]
    elif isinstance(value, dict):
        out = {_KIND: "dict", "of": [[k, _plain(v)] for k, v in value.items()]}
    elif isinstance(value, (np.ndarray, np.void)):
        name = next((n for n, d in _DTYPES.items() if d == value.dtype), value.dtype.str)
        out = {_KIND: "array", "dtype": name, "shape": list(value.shape), "data": value.tobytes()}
    elif isinstance(value, np.generic):
        out = value.item()
    elif value is not None and kind not in {bool, int, float, str}:
        raise TypeError(f"{kind.__name__} is no kind of fact that is remembered")
    return out


def _back(value: Any) -> Any:
    """Return the value that `_plain` took apart."""
    if isinstance(value, list):
        return [_back(v) for v in value]
    if not isinstance(value, dict):
        return value
    kind = value.pop(_KIND)
    if kind == "tuple":
        return tuple(_back(v) for v in value["of"])
    if kind == "dict":
        return {k: _back(v) for k, v in value["of"]}
    if kind == "array":
        dtype = _DTYPES.get(value["dtype"]) or np.dtype(value["dtype"])
        array = np.frombuffer(value["data"], dtype).reshape(value["shape"]).copy()
        return array if array.shape else array[()]
    return _KINDS[kind](**{name: _back(v) for name, v in value.items()})
