"""Records to JSON, and back."""

from __future__ import annotations

import math
from typing import Any

import msgspec

from monitor.contract.records import TIMES, Assessment, Event, LoopRow, Suggestion
from monitor.contract.times import iso, time_of

RECORD_SCHEMA = 1
FRAME_MIME = "application/vnd.apache.arrow.stream"
JSON_MIME = "application/json"
decode_object = msgspec.json.Decoder(dict[str, Any]).decode


# ---------------------------------------------------------------------------------------------------
# records to bytes

_encoder = msgspec.json.Encoder()


def to_json(fields: dict[str, Any]) -> bytes:
    """Encode with ``schema``; NaN and infinity become null, times ISO text.

    Examples
    --------
    >>> to_json({"loop": "LIC-101", "ci": float("nan")})
    b'{"schema":1,"loop":"LIC-101","ci":null}'
    """
    clean = {k: iso(v) if k in TIMES and isinstance(v, int) else _clean(v) for k, v in fields.items()}
    return _encoder.encode({"schema": RECORD_SCHEMA, **clean})


def _clean(value: Any) -> Any:
    if isinstance(value, float):  # NumPy's too, which JSON knows nothing of
        return float(value) if math.isfinite(value) else None
    if isinstance(value, dict):
        return {k: _clean(v) for k, v in value.items()}
    return value


def encode_record(record: Event | Assessment | LoopRow | Suggestion) -> bytes:
    """Return a record as JSON."""
    if isinstance(record, Suggestion):
        return to_json({**msgspec.structs.asdict(record.row), "evidence": record.evidence})
    return to_json(msgspec.structs.asdict(record))


def decode_event(payload: bytes) -> Event:
    """Read an event that `encode_record` wrote; one that cannot be read is of no loop."""
    try:
        fields = decode_object(payload)
        start = time_of(fields["start"], 0)
        return msgspec.convert({**fields, "start": start, "end": None}, Event)
    except (msgspec.MsgspecError, KeyError, ValueError, TypeError):
        return Event(id="", loop="", kind="", state="", start=0, end=None, amplitude=0.0)


def decode_record(payload: bytes) -> dict[str, Any]:
    """Read an event, an assessment, a row or a health record, a JSON object.

    Raises
    ------
    ValueError
        It is no JSON object.
    """
    record = msgspec.json.decode(payload)
    if not isinstance(record, dict):
        raise ValueError("no JSON object")  # noqa: TRY004 - one kind of error for one bad payload
    return record
