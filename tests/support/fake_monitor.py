"""A monitor that only talks: simulated loops with their events, published and answered as the real one does.

Run by itself it serves as a partner for ``loopsight view``: ``python -m tests.support.fake_monitor [PORT]``.
"""

from __future__ import annotations

import json
import sys
import time
from dataclasses import dataclass, field
from datetime import UTC, datetime
from functools import cache
from typing import Any

import numpy as np
import pyarrow as pa
import zenoh
from numpy.typing import NDArray

from tests.support.plants import pi_loop
from tests.support.waiting import heard

Floats = NDArray[np.float64]
EPOCH = int(datetime(2026, 3, 2, 8, 0, tzinfo=UTC).timestamp())


@dataclass
class Loop:
    """An integrating process ``gain e^(-dead_time s) / (s (lag s + 1))`` under a PI controller."""

    name: str
    gain: float
    dead_time: int
    lag: float
    kp: float
    ti: float
    kind: str = "setpoint"
    amplitude: float = 5.0
    sp0: float = 50.0
    op0: float = 40.0
    length: int = 1800
    noise: float = 0.05
    verdict: str = "retune"
    key: str = ""
    onset_at: int = 120
    columns: dict[str, Floats] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Simulate it."""
        self.key = self.key or f"plant/{self.name}"
        facts = (self.gain, self.dead_time, self.lag, self.kp, self.ti, self.kind, self.amplitude)
        columns = simulate(*facts, self.sp0, self.op0, self.length, self.noise, self.onset_at)
        self.columns = {name: column.copy() for name, column in columns.items()}

    @property
    def id(self) -> str:
        """Id of its event."""
        return self.key.encode().hex()[-16:]

    @property
    def onset(self) -> int:
        """[ns since 1970]."""
        return int(self.columns["time"][self.onset_at])


@cache
def simulate(
    gain: float,
    delay: int,
    lag: float,
    kp: float,
    ti: float,
    kind: str,
    amplitude: float,
    sp0: float,
    op0: float,
    length: int,
    noise: float,
    onset: int,
) -> dict[str, Any]:
    """The closed loop, a second a sample; ``model`` is the response without noise."""
    sp, size = np.full(length, sp0), amplitude if kind == "load" else 0.0
    if kind == "setpoint":
        sp[onset:] += amplitude

    def run(noise: float) -> tuple[Floats, Floats]:
        return pi_loop(
            sp, kp=kp, ti=ti, gain=gain, dead=delay, lag=lag, noise=noise, seed=1, op0=op0, low=0.0, high=100.0,
            load=lambda k: size if k >= onset else 0.0,
        )  # fmt: skip

    (pv, op), (clean, _) = run(noise), run(0.0)
    time_ns = (EPOCH + np.arange(length, dtype=np.int64)) * 1_000_000_000
    return {"time": time_ns, "sp": sp, "pv": pv, "op": op, "model": clean}


def demo_loops() -> list[Loop]:
    """A handful of levels and pressures, some badly tuned."""
    return [
        Loop("LIC-101", 0.002, 8, 5.0, 9.0, 36.0),
        Loop("PIC-204", 0.004, 5, 3.0, 5.0, 30.0, kind="load", amplitude=12.0, sp0=6.0, op0=55.0, noise=0.02),
        Loop("LIC-330", 0.0012, 14, 8.0, 4.0, 1500.0, length=3600, sp0=65.0, amplitude=4.0),
        Loop("LIC-118", 0.003, 6, 4.0, 22.0, 40.0, length=900, sp0=42.0, amplitude=1.5, noise=0.02),
        Loop("FIC-007", 0.004, 4, 2.0, 20.0, 80.0, verdict="good"),
        Loop("TIC-055", 0.001, 20, 10.0, 8.0, 300.0, verdict="inconclusive"),
    ]


def iso(ns: int) -> str:
    """Time as the wire has it."""
    return datetime.fromtimestamp(ns / 1e9, UTC).isoformat().replace("+00:00", "Z")


def window_payload(loop: Loop) -> bytes:
    """The event's evidence as an Arrow stream."""
    facts = {
        "id": loop.id,
        "loop": loop.name,
        "onset": str(loop.onset),
        "verdict": loop.verdict,
        "reason": "",
    }
    return arrow(loop.columns, facts)


def trend_payload(loop: Loop, rows: slice) -> bytes:
    """Some samples as an Arrow stream."""
    return arrow({k: loop.columns[k][rows] for k in ("time", "sp", "pv", "op")}, {"loop": loop.name})


def arrow(columns: dict[str, Any], facts: dict[str, str]) -> bytes:
    """Columns and facts as an Arrow stream."""
    arrays = [
        pa.array(v, pa.timestamp("ns", "UTC")) if k == "time" else pa.array(v, pa.float64())
        for k, v in columns.items()
    ]
    batch = pa.record_batch(arrays, names=list(columns)).replace_schema_metadata(facts)
    sink = pa.BufferOutputStream()
    with pa.ipc.new_stream(sink, batch.schema) as writer:
        writer.write_batch(batch)
    return sink.getvalue().to_pybytes()


def assessment(loop: Loop) -> dict[str, Any]:
    """The event, judged."""
    c = loop.columns
    theta = loop.dead_time + loop.lag / 2
    e = np.abs(c["sp"] - c["model"])
    iae = float(e.sum())
    tight = 3.943 * loop.amplitude * theta / iae
    ci = tight if loop.kind == "setpoint" else 16 * loop.gain * theta**2 * loop.amplitude / iae
    reasons = {
        "retune": f"too much integral action for its gain: IAE {1 / ci:.1f} times that of a well-tuned loop",
        "good": "",
        "inconclusive": "OP was at its limit for 31 % of the event",
    }
    return {
        "schema": 1, "loop": loop.name, "id": loop.id, "event": 1, "kind": loop.kind,
        "start": iso(loop.onset), "end": iso(int(c["time"][-1])), "state": "settled",
        "amplitude": loop.amplitude, "iae": iae, "ci": ci, "process": "integrating",
        **model(loop), "method": "joint", "fit": 0.9962, "coverage": 1.0,
        "verdict": loop.verdict, "reason": reasons[loop.verdict],
    }  # fmt: skip


def model(loop: Loop) -> dict[str, float]:
    """The loop's model with intervals."""
    facts = {}
    for name, value, rel in (
        ("gain", loop.gain, 0.03), ("t0", loop.dead_time + loop.lag, 0.05),
        ("dead_time", loop.dead_time, 0.07), ("lag", loop.lag, 0.12),
    ):  # fmt: skip
        facts |= {name: value, f"{name}_lo": value * (1 - rel), f"{name}_hi": value * (1 + rel)}
    return facts


def row(loop: Loop) -> dict[str, Any]:
    """The loop's current row."""
    a = assessment(loop)
    theta = loop.dead_time + loop.lag / 2
    facts: dict[str, Any] = {
        "schema": 1, "loop": loop.name, "verdict": loop.verdict, "reason": a["reason"], "events": 1,
        "action": "", "ci_setpoint": a["ci"] if loop.kind == "setpoint" else None,
        "ci_load": a["ci"] if loop.kind == "load" else None, "ms": 2.9, "process": "integrating",
        **model(loop),
    }  # fmt: skip
    if loop.verdict == "retune":
        kp, ti = 1 / (2 * loop.gain * theta), 8 * theta
        stages = [{"kp": (loop.kp * kp) ** 0.5, "ti": ti}, {"kp": kp, "ti": ti}]
        facts |= {
            "action": "set the new values in the stages given, with a look in between",
            "kp": loop.kp, "ti": loop.ti, "td": 0.0, "tf": 0.0,
            "rule": "simc-pi", "form": "standard", "new_kp": kp, "new_ti": ti, "new_td": 0.0, "new_tf": 0.0,
            "new_fields": json.dumps({"GAIN": round(kp, 3), "RESET": round(ti, 1)}), "new_ms": 1.70,
            "new_ms_worst": 1.86, "new_ci": 0.98, "new_op_noise": 0.4, "stages": json.dumps(stages),
        }  # fmt: skip
    return facts


class FakeMonitor:
    """A router session on ``port`` of the loopback interface that publishes and answers for ``loops``."""

    def __init__(self, port: int, loops: list[Loop]) -> None:
        self.endpoint = f"tcp/127.0.0.1:{port}"
        self.loops = loops
        self.asked: set[str] = set()
        """What has been asked for: ``status``, ``history/ID``, ``window/ID``."""
        self.silent = False
        """Leave questions about the state unanswered."""
        config = zenoh.Config()
        for key, value in (
            ("mode", "router"),
            ("scouting/multicast/enabled", False),
            ("scouting/gossip/enabled", False),
            ("listen/endpoints", [self.endpoint]),
        ):
            config.insert_json5(key, json.dumps(value))
        self.session = zenoh.open(config)
        self._queryables = [
            self.session.declare_queryable(f"loopsight/{loop.key}/{leaf}", self._answer(loop, leaf))
            for loop in loops
            for leaf in ("status", f"history/{loop.id}", f"window/{loop.id}")
        ]

    def _answer(self, loop: Loop, leaf: str) -> Any:
        def answer(query: zenoh.Query) -> None:
            with query:
                self.asked.add(leaf)
                if self.silent and leaf == "status":
                    return
                if leaf.startswith("window"):
                    payload = window_payload(loop)
                else:
                    payload = json.dumps(row(loop) if leaf == "status" else assessment(loop)).encode()
                query.reply(f"loopsight/{loop.key}/{leaf}", payload)

        return answer

    def put(self, key: str, payload: bytes | dict[str, Any]) -> float:
        """Publish under the prefix; returns how long it took [s]."""
        data = json.dumps(payload).encode() if isinstance(payload, dict) else payload
        start = time.perf_counter()
        self.session.put(f"loopsight/{key}", data, congestion_control=zenoh.CongestionControl.DROP)
        return time.perf_counter() - start

    def heard(self, key: str) -> bool:
        """Whether somebody listens to this key; he is known here a moment after he has begun."""
        return heard(self.session, f"loopsight/{key}")

    def tell(self, loop: Loop) -> None:
        """Publish all that an assessed event gives."""
        facts = {
            "schema": 1,
            "id": loop.id,
            "loop": loop.name,
            "kind": loop.kind,
            "amplitude": loop.amplitude,
        }
        start, end = iso(loop.onset), iso(int(loop.columns["time"][-1]))
        self.put(f"{loop.key}/event", {**facts, "state": "open", "start": start, "end": None})
        self.put(f"{loop.key}/event", {**facts, "state": "settled", "start": start, "end": end})
        self.put(f"{loop.key}/window", window_payload(loop))
        self.put(f"{loop.key}/assessment", assessment(loop))
        if loop.verdict == "retune":
            self.put(f"{loop.key}/suggestion", {**row(loop), "evidence": [loop.id]})

    def go_on(self, loop: Loop, start: int, seconds: int, first: int = 60) -> None:
        """Publish more of the trend: what the loop did from sample ``first``, again at ``start`` [s]."""
        rows = {k: loop.columns[k][first : first + seconds] for k in ("sp", "pv", "op")}
        rows["time"] = (EPOCH + start + np.arange(len(rows["sp"]), dtype=np.int64)) * 1_000_000_000
        self.put(f"{loop.key}/trend", arrow(rows, {"loop": loop.name}))

    def health(self) -> None:
        """Publish the health record."""
        self.put("@/fake/status", {"schema": 1, "samples_ok": 123456, "rejected": 0, "backlog": 0})

    def close(self) -> None:
        """End the session."""
        self.session.close()


def main() -> None:
    """Serve the demo's loops, and go on with their trends, until interrupted."""
    fake = FakeMonitor(int(sys.argv[1]) if len(sys.argv) > 1 else 7447, demo_loops())
    print(f"ready {fake.endpoint}", flush=True)
    try:
        for second in range(100_000):
            if second % 10 == 0:
                fake.health()
            for loop in fake.loops:
                if loop.verdict == "retune":
                    fake.go_on(loop, 3600 + second * 20, 20, second * 20 % 800)
            if second in (2, 4, 6, 8, 10, 12):
                fake.tell(fake.loops[second // 2 - 1])
            time.sleep(1.0)
    except KeyboardInterrupt:
        fake.close()


if __name__ == "__main__":
    main()
