"""The engine on a DataFrame: samples of one loop in, its events, its process and its verdict out.

Whatever gives set point, PV and output with their times will do; here a simulated tank under a slow PI stands in
for a plant.

python examples/engine_on_dataframe.py
"""

from __future__ import annotations

import numpy as np
import pandas as pd

from monitor import Assessment, Engine, Loop, LoopRow, LoopTable, Samples, Suggestion

TODAY = Loop(name="LIC-101", kp=0.5, ti=180.0, op_low=0.0, op_high=100.0)
"""What is known of the loop: today's settings [OP/PV], [s], and the ends of OP."""


def tank(seconds: int = 3600) -> pd.DataFrame:
    """Simulate a level under PI, a sample a second: the set point steps by 2 after ten minutes.

    The process has a gain of 0.05 [PV/(OP s)] and a dead time of 4 s.
    """
    noise = np.random.default_rng(1).normal(0.0, 0.01, seconds)
    sp = np.where(np.arange(seconds) < 600, 50.0, 52.0)
    level, integral, outputs, measured = 50.0, 0.0, [40.0] * 4, []
    for k in range(seconds):
        pv = level + noise[k]
        error = sp[k] - pv
        integral += error / 180.0
        outputs.append(float(np.clip(40.0 + 0.5 * (error + integral), 0.0, 100.0)))
        level += 0.05 * (outputs[k] - 40.0)
        measured.append(pv)
    time = pd.date_range("2026-01-01", periods=seconds, freq="s", tz="UTC")
    return pd.DataFrame({"time": time, "sp": sp, "pv": measured, "op": outputs[4:]})


def watch(data: pd.DataFrame, loop: Loop) -> tuple[list[Assessment | Suggestion], LoopRow]:
    """Return what was found in the data on the way, and the loop's row at the end."""
    engine = Engine(LoopTable([loop]))
    time = data["time"].to_numpy("datetime64[ns]").astype(np.int64)
    samples = Samples.of(loop=0, time=time, sp=data["sp"], pv=data["pv"], op=data["op"])
    records = engine.step(samples) + engine.flush()
    found = [record for record in records if isinstance(record, Assessment | Suggestion)]
    return found, engine.row(0)


if __name__ == "__main__":
    found, row = watch(tank(), TODAY)
    for record in found:
        if isinstance(record, Assessment):
            print(f"{record.kind} step of {record.amplitude:g}: {record.verdict}; {record.reason}")
            print(f"  gain {record.gain:.4f} ({record.gain_lo:.4f} ... {record.gain_hi:.4f}) [PV/(OP s)]")
            print(f"  dead time {record.dead_time:.2f} s, CI = {record.ci:.2f}, Ms = {record.ms:.2f}")
    print(f"{row.loop}: {row.verdict}; {row.action}")
