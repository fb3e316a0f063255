"""Ingest against its floor: how much of a subscriber's rate is left when the monitor works behind it.

Run: ``python -m tests.bench.bench_ingest`` (``--quick`` for a smoke check, ``--no-zenoh`` in this process only,
``--profile`` for where the time goes). Ratios are what counts; the rates depend on the machine.

The floor decodes the payload and does nothing with it: a frame's columns to NumPy arrays, a JSON sample with
msgspec to a struct.
"""

from __future__ import annotations

import argparse
import cProfile
import json
import pstats
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from typing import Any

import msgspec
import numpy as np
import pyarrow as pa

from monitor.adapters.inbox import Inbox
from monitor.adapters.zenoh_bus import Bus, open_session, plant_put
from monitor.contract.entries import Message
from monitor.contract.loops import Loop, LoopTable
from monitor.engine import Engine
from monitor.service.reorder import Reorder
from monitor.service.service import Service
from monitor.service.warm_up import warm_up
from monitor.wire.decode import Decoder, _Sample
from sim_plants.loops import Block
from sim_plants.payloads import encode_frame, encode_sample, iso_times, name_array
from tests.support.bus import FakeBus
from tests.support.places import ROOT
from tests.support.waiting import free_port

START = 1_767_225_600 * 10**9
LATER = 2**62
FRAME = 1000
NAMES = ("time", "sp", "pv", "op")


def quiet(loops: int, second: int) -> Block:
    """One sample of each loop: at rest, with noise."""
    rng = np.random.default_rng(second)
    n = np.arange(loops, dtype=np.int32)
    time_ns = np.full(loops, START + second * 10**9)
    pv = 50.0 + 0.1 * rng.standard_normal(loops)
    return Block(n, time_ns, np.full(loops, 50.0), pv, np.full(loops, 30.0), np.ones(loops, np.bool_))


def frames(loops: int, seconds: int) -> list[list[Message]]:
    """Frames of a thousand loops, second by second."""
    names = name_array([f"L{k}" for k in range(loops)])
    out = []
    for second in range(seconds):
        block = quiet(loops, second)
        out.append(
            [
                Message(
                    f"plant/area{a}/frame", encode_frame(names, block.rows(slice(a, a + FRAME)), second), 0
                )
                for a in range(0, loops, FRAME)
            ]
        )
    return out


def singles(loops: int, seconds: int) -> list[list[Message]]:
    """JSON samples, second by second."""
    out = []
    for second in range(seconds):
        b = quiet(loops, second)
        rows = zip(
            b.loop.tolist(), iso_times(b.time_ns), b.sp.tolist(), b.pv.tolist(), b.op.tolist(), strict=True
        )
        out.append([Message(f"plant/L{k}", encode_sample(t, s, p, o, True), 0) for k, t, s, p, o in rows])
    return out


_sample = msgspec.json.Decoder(_Sample).decode


def floor(message: Message) -> int:
    """Decode and do nothing; return the samples."""
    if not message.key.endswith("/frame"):
        _sample(message.payload)
        return 1
    n = 0
    for batch in pa.ipc.open_stream(message.payload):
        column = batch.column("loop")
        column.indices.to_numpy(zero_copy_only=False)
        for name in NAMES:
            batch.column(name).to_numpy(zero_copy_only=False)
        n += len(batch)
    return n


class Chain:
    """Inbox, decoder, order, engine: what a tick does, without bus and store."""

    def __init__(self, loops: int) -> None:
        self.table = LoopTable([Loop(name=f"L{k}", kp=1.0, ti=10.0) for k in range(loops)])
        self.inbox, self.decoder = Inbox(), Decoder(self.table)
        self.reorder, self.engine = Reorder(loops), Engine(self.table)
        self.stage = dict.fromkeys(("ring", "decode", "order", "engine"), 0.0)

    def step(self) -> None:
        """One tick."""
        t = [time.perf_counter()]
        messages = self.inbox.take(50_000, 16 * 2**20)
        t.append(time.perf_counter())
        entries = self.decoder.decode(messages, LATER)
        t.append(time.perf_counter())
        samples = self.reorder.push(entries, t[0])
        t.append(time.perf_counter())
        self.engine.step(samples)
        t.append(time.perf_counter())
        for name, a, b in zip(self.stage, t, t[1:], strict=False):
            self.stage[name] += b - a


def in_process(name: str, seconds: list[list[Message]], loops: int) -> float:
    """Floor and chain in turn, each message taken from a ring; print and return the ratio of the best."""
    total = sum(map(len, seconds))
    samples = total * (FRAME if name == "frames" else 1)
    rates: dict[str, list[float]] = {"floor": [], "chain": []}
    stage: dict[str, float] = {}
    for _ in range(3):
        inbox: Inbox[Message] = Inbox()
        began = time.perf_counter()
        for second in seconds:
            for message in second:
                inbox.put(message)
            for message in inbox.take(len(second)):
                floor(message)
        rates["floor"].append(samples / (time.perf_counter() - began))
        chain = Chain(loops)
        began = time.perf_counter()
        for second in seconds:
            for message in second:
                chain.inbox.put(message)
            while len(chain.inbox):
                chain.step()
        rates["chain"].append(samples / (time.perf_counter() - began))
        stage = chain.stage
        assert chain.engine.seen.counts()["ok"] + chain.reorder.waiting == samples
    best = {k: max(v) for k, v in rates.items()}
    ratio = best["chain"] / best["floor"]
    share = {k: f"{v / sum(stage.values()):.0%}" for k, v in stage.items()}
    print(
        f"in process  {name:8} floor {best['floor']:12,.0f}/s  chain {best['chain']:12,.0f}/s  {ratio:5.0%}  {share}"
    )
    return ratio


PUBLISH = """
import sys
from tests.bench.bench_ingest import publish
publish(sys.argv[1], sys.argv[2], int(sys.argv[3]), int(sys.argv[4]), int(sys.argv[5]))
"""


def publish(endpoint: str, kind: str, loops: int, seconds: int, rounds: int) -> None:
    """Send as fast as the subscriber takes it, then an end mark; wait for a line before each round."""
    made = (frames if kind == "frames" else singles)(loops, seconds)
    session = open_session("client", connect=[endpoint])
    put = plant_put(session)
    print("made", flush=True)
    for _ in range(rounds):
        sys.stdin.readline()
        for second in made:
            for message in second:
                put(message.key, message.payload)
        put("plant/end", b"{}")
    sys.stdin.readline()
    session.close()


def over_zenoh(kind: str, loops: int, seconds: int) -> float:
    """The same with a publisher in another process and the bus's callback in front."""
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    bus = Bus(open_session("router", listen=[endpoint]))
    bus.subscribe(["plant/**"], time.time_ns)
    rounds = 6
    command = [sys.executable, "-c", PUBLISH, endpoint, kind, str(loops), str(seconds), str(rounds)]
    child = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, cwd=ROOT)
    assert child.stdin is not None
    assert child.stdout is not None
    rates: dict[str, list[float]] = {"floor": [], "chain": []}
    try:
        child.stdout.readline()
        for number in range(rounds):
            which = "chain" if number % 2 else "floor"
            chain = Chain(loops)
            chain.inbox = bus.inbox
            done = threading.Event()
            work: Callable[[list[Message]], Any]
            if which == "floor":

                def work(messages: list[Message]) -> None:
                    for m in messages:
                        floor(m)
            else:

                def work(messages: list[Message], chain: Chain = chain) -> None:
                    entries = chain.decoder.decode(messages, LATER)
                    chain.engine.step(chain.reorder.push(entries, 0.0))

            first, n = 0.0, 0
            child.stdin.write("\n")
            child.stdin.flush()
            deadline = time.monotonic() + 120
            while not done.is_set():
                messages = bus.inbox.take(50_000, 16 * 2**20)
                if not messages:
                    assert time.monotonic() < deadline, "no end"
                    time.sleep(0.0005)
                    continue
                first = first or time.perf_counter()
                if messages[-1].key == "plant/end":
                    messages.pop()
                    done.set()
                n += len(messages)
                work(messages)
            samples = n * (FRAME if kind == "frames" else 1)
            rates[which].append(samples / (time.perf_counter() - first))
    finally:
        child.communicate("\n", timeout=30)
        dropped = bus.inbox.dropped
        bus.close()
    best = {k: max(v) for k, v in rates.items()}
    ratio = best["chain"] / best["floor"]
    print(
        f"over Zenoh  {kind:8} floor {best['floor']:12,.0f}/s  chain {best['chain']:12,.0f}/s  {ratio:5.0%}  "
        f"({dropped} dropped)"
    )
    return ratio


class _Forgetful:
    """A store without a disk."""

    def rows(self) -> dict[str, bytes]:
        """Nothing."""
        return {}

    def tidy(self, _: int) -> bool:
        """Nothing is old."""
        return False


def ticks(loops: int, seconds: int) -> float:
    """A service at 1 Hz, a tick for every frame: print p50 and p99 of a tick [ms], and the load on a core."""
    from monitor.service.config import Config  # noqa: PLC0415

    table = LoopTable([Loop(name=f"L{k}", kp=1.0, ti=10.0) for k in range(loops)])
    bus: Any = FakeBus(keep=False)
    store: Any = _Forgetful()
    now = [0.0]
    service = Service(Config(loops="x"), table, bus, store, clock=lambda: START * 2, monotonic=lambda: now[0])
    took = []
    for second in frames(loops, seconds):
        for message in second:
            now[0] += 1.0 / len(second)
            bus.inbox.put(message)
            began = time.perf_counter()
            service.tick()
            took.append(time.perf_counter() - began)
    began = time.perf_counter()
    for _ in range(20):
        service.tick()
    empty = (time.perf_counter() - began) / 20
    worst = np.percentile(took[len(took) // 4 :], [50, 99]) * 1e3
    settled = took[len(took) // 4 :]  # the first seconds touch new memory
    load = sum(settled) / (len(settled) * seconds / len(took))
    print(
        f"ticks       {loops:,} loops at 1 Hz, a tick a frame: p50 {worst[0]:.2f} ms, p99 {worst[1]:.2f} ms, "
        f"an empty tick {empty * 1e3:.2f} ms, {load:.1%} of a core"
    )
    return float(worst[1])


def main() -> None:
    """Run all and print a line each; the last line is JSON."""
    options = argparse.ArgumentParser()
    options.add_argument("--quick", action="store_true")
    options.add_argument("--no-zenoh", action="store_true")
    options.add_argument("--profile", action="store_true")
    asked = options.parse_args()
    warm_up()
    size = 1 if asked.quick else 5
    made = {"frames": (frames(10_000, 10 * size), 10_000), "singles": (singles(1000, 20 * size), 1000)}
    if asked.profile:
        for name, (seconds, loops) in made.items():
            with cProfile.Profile() as profile:
                in_process(name, seconds, loops)
            pstats.Stats(profile).sort_stats("tottime").print_stats(18)
        return
    out = {f"in_process_{n}": in_process(n, seconds, loops) for n, (seconds, loops) in made.items()}
    if not asked.no_zenoh:
        out |= {
            "zenoh_frames": over_zenoh("frames", 10_000, 10 * size),
            "zenoh_singles": over_zenoh("singles", 1000, 20 * size),
        }
    out["p99_ms_10000"] = ticks(10_000, 4 * size)
    if not asked.quick:
        out["p99_ms_100000"] = ticks(100_000, 8)
    print(json.dumps({k: round(v, 3) for k, v in out.items()}))


if __name__ == "__main__":
    main()
