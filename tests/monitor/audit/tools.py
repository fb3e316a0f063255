"""A small fleet to audit, and what an audit wrote."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from click.testing import CliRunner, Result

from monitor.cli.audit import audit as audit_command
from tests.support.plants import pi_loop

FILES = (
    *("events.parquet", "loops.parquet", "loops.csv", "loops.xlsx", "audit.json"),
    *("evidence.parquet", "answers.parquet", "spells.parquet", "report.html"),
)
START = np.datetime64("2026-03-01T00:00:00", "ns").astype(np.int64)


def step_test(name: str, n: int = 900, seed: int = 0) -> pd.DataFrame:
    """A level under PI, 1 s samples, its set point stepped at 300 s and back at 600 s."""
    sp = np.where((np.arange(n) >= 300) & (np.arange(n) < 600), 55.0, 50.0)
    pv, op = pi_loop(sp, kp=8.0, ti=40.0, gain=0.01, dead=2, noise=0.02, seed=seed, op0=40.0)
    return pd.DataFrame({"loop": name, "time": START + 10**9 * np.arange(n), "sp": sp, "pv": pv, "op": op})


def content(out: Path) -> dict[str, bytes]:
    """All files of an audit, the time of its making left out."""
    found = {f: (out / f).read_bytes() for f in FILES}
    about = json.loads(found["audit.json"])
    assert about.pop("generated_at").endswith("Z")
    return {**found, "audit.json": json.dumps(about).encode()}


def command(*args: object) -> Result:
    return CliRunner().invoke(audit_command, [str(a) for a in args])


def about(out: Path) -> dict[str, Any]:
    return dict(json.loads((out / "audit.json").read_text()))
