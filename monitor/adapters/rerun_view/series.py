"""What is drawn of a loop: which series there are, where they lie in the recording, and how they look.

A path is made from names, never the names themselves: a loop's name, and an event's id, is data.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Sequence

import rerun as rr

from monitor.contract.evidence import Scale
from monitor.contract.text import plain

TIMELINE = "time"
SP_COLOUR, PV_COLOUR, OP_COLOUR = (165, 165, 165), (70, 140, 240), (240, 150, 40)
MODEL_COLOUR, ONSET_COLOUR, NEW_COLOUR = (235, 60, 60), (190, 120, 255), (40, 190, 130)
BAND_COLOUR = (*NEW_COLOUR, 150)
ONSET, SP, PV, MODEL = "1-onset", "2-sp", "3-pv", "4-model"
ONSET_OP, OP = "5-onset", "6-op"
NOISE, RESIDUAL = "7-noise", "8-residual"
RESPONSE_SP, TODAY, BAND, NEW = "1-sp", "2-today", "3-band", "4-new"
"""Series by path: Rerun draws in the order of paths, and the thin model belongs on top of the data."""
NOISE_SD = 2.0
"""Half the band that noise alone keeps a residual in [standard deviations]."""
MOST_UNIT = 12
"""Characters of a unit that a legend shows."""


def entity(loop: str) -> str:
    """Path of a loop's entities: readable where the name is plain, always unique, never a path of its own."""
    return f"loop/{_part(loop)}"


def of_event(base: str, series: str, event: str) -> str:
    """Path of one event's series, of which each event has its own; ``base``: the loop's entity."""
    return f"{base}/event/{series}/{_part(event)}"


def _part(name: str) -> str:
    readable = re.sub(r"[^A-Za-z0-9_-]", "_", name)[:40]
    digest = hashlib.blake2b(name.encode("utf-8", "surrogatepass"), digest_size=4).hexdigest()
    return f"{readable}-{digest}"


def live_looks(scale: Scale) -> dict[str, rr.SeriesLines]:
    """Return the looks of SP, PV and OP, by series. SP and OP are held between samples."""
    pv, op = units(scale)
    return {
        SP: _look(f"SP [{pv}]", SP_COLOUR, 1.5, "StepAfter"),
        PV: _look(f"PV [{pv}]", PV_COLOUR, 2.2),
        OP: _look(f"OP [{op}]", OP_COLOUR, 1.8, "StepAfter"),
    }


def event_looks(scale: Scale) -> dict[str, rr.SeriesLines]:
    """Return the looks of an event's series."""
    pv, _ = units(scale)
    onset = _look("onset", ONSET_COLOUR, 1.5, policy="Off")
    return live_looks(scale) | {
        MODEL: _look(f"model of PV [{pv}]", MODEL_COLOUR, 1.3, policy="Average"),
        ONSET: onset,
        ONSET_OP: onset,
        RESIDUAL: _look(f"PV less model [{pv}]", PV_COLOUR, 1.3),
        NOISE: _look(("noise", "noise"), SP_COLOUR, 1.0),
    }


def response_looks() -> dict[str, rr.SeriesLines]:
    """Return the looks of predicted responses; the chart's name has their unit."""
    return {
        RESPONSE_SP: _look("SP", SP_COLOUR, 1.5, "StepAfter"),
        TODAY: _look("today", MODEL_COLOUR, 1.6),
        NEW: _look("new", NEW_COLOUR, 2.2),
        BAND: _look(("its band", "its band"), BAND_COLOUR, 1.0),
    }


def units(scale: Scale) -> tuple[str, str]:
    """Units of PV and OP for a legend; PV, OP where they are not known."""
    return plain(scale.unit, MOST_UNIT) or "PV", plain(scale.op_unit, MOST_UNIT) or "OP"


def _look(
    names: str | Sequence[str],
    colour: tuple[int, ...],
    width: float,
    mode: str = "Linear",
    policy: str = "MinMax",
) -> rr.SeriesLines:
    names = [names] if isinstance(names, str) else names
    return rr.SeriesLines(
        names=names,
        colors=[colour] * len(names),
        widths=[width] * len(names),
        interpolation_mode=mode,
        aggregation_policy=policy,
    )
