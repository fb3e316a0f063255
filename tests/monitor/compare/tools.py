"""A loop before and after, made up: rows, events and spells of time."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from monitor.adapters.audit_folder import AuditFolder
from monitor.contract.records import Assessment, LoopRow, Spell

START = 1_772_323_200 * 10**9
HOUR_NS = 3600 * 10**9


def row(name: str = "LIC-1", **more: object) -> LoopRow:
    """A loop whose settings the table gives."""
    facts: dict[str, object] = {
        "loop": name, "verdict": "good", "kp": 2.0, "ti": 60.0, "td": 0.0, "settings_source": "table", "noise": 0.02,
    }  # fmt: skip
    return LoopRow(**{**facts, **more})  # type: ignore[arg-type]


def events(
    ci: Sequence[float], name: str = "LIC-1", kind: str = "setpoint", amplitude: float = 5.0, ms: float = 1.5
) -> list[Assessment]:
    """One event an hour with these indices."""
    return [
        Assessment(loop=name, id=f"{name}/{k}", event=k + 1, kind=kind, start=START + k * HOUR_NS,
                   end=START + k * HOUR_NS + HOUR_NS // 2, state="settled", amplitude=amplitude, iae=50.0 / value,
                   ci=value, ms=ms, verdict="good", reason="")
        for k, value in enumerate(ci)
    ]  # fmt: skip


def spells(error: float, name: str = "LIC-1", n: int = 24, seed: int = 0) -> list[Spell]:
    """Hours with a mean error about ``error`` [PV]."""
    sizes = error * np.random.default_rng(seed).uniform(0.9, 1.1, n)
    return [
        Spell(loop=name, start=START + k * HOUR_NS, seconds=3600.0, error=e, error_rms=1.3 * e, op_path=10.0)
        for k, e in enumerate(sizes.tolist())
    ]


def audit(
    rows: Sequence[LoopRow],
    found: Sequence[Assessment] = (),
    hours: Sequence[Spell] = (),
    lacks: tuple[str, ...] = (),
) -> AuditFolder:
    """An audit as it is read."""
    about = {"versions": {"loopsight": "0.1.0"}, "counts": {"events": len(found)}}
    return AuditFolder(Path("audit"), about, list(rows), list(found), list(hours), lacks)
