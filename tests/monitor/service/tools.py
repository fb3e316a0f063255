"""A service with everything around it, a step to feed it with, and the demo as a command."""

from __future__ import annotations

import json
import sys
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from monitor.adapters.store import Store, StoreError
from monitor.contract.loops import Loop, LoopTable
from monitor.contract.records import Assessment
from monitor.service.config import Config
from monitor.service.service import Service
from sim_plants.publish import Publisher
from tests.support.bus import FakeBus, Question
from tests.support.stores import quick

START = 1_767_225_600
SENT = START * 10**9
"""[ns]"""
LATER = (START + 100_000) * 10**9


def command(*options: str) -> list[str]:
    return [sys.executable, "-m", "monitor", "demo", "--view", "none", *options]


class Broken(Store):
    """A store whose disk can fail."""

    failing = False
    commits = 0
    tries = 0

    @contextmanager
    def transaction(self) -> Any:
        self.tries += 1
        if self.failing:
            raise StoreError("disk full")
        with super().transaction():
            yield
        self.commits += 1


class Bench:
    """A service with everything around it."""

    def __init__(self, folder: Path, loops: LoopTable | None = None, **config: Any) -> None:
        self.bus = FakeBus()
        self.store = quick(folder, Broken)
        self.now = 0.0
        self.heard: list[Any] = []
        self.loops = LoopTable([]) if loops is None else loops
        self.service = Service(
            Config(loops="x" if loops is not None else "", **config), self.loops, self.bus, self.store,
            heard=self.heard.append, clock=lambda: LATER, monotonic=lambda: self.now,
        )  # fmt: skip

    def tick(self, seconds: float = 0.0) -> None:
        self.now += seconds
        self.service.tick()

    def ask(self, key: str, parameters: str = "") -> Question:
        question = Question(key, parameters)
        self.bus.questions.append(question)
        self.tick()
        assert question.replies is not None or question.error is not None
        return question

    def status(self) -> dict[str, Any]:
        """As a reader of its JSON sees it."""
        return dict(msgspec.to_builtins(self.service.status()))

    @property
    def assessments(self) -> list[Assessment]:
        return [r for r in self.heard if isinstance(r, Assessment)]


def a_step(n: int = 400, at: int = 200) -> list[tuple[str, bytes]]:
    """Samples of a loop L with a step of its set point, quickly settled."""
    sp = (np.arange(n) >= at) * 1.0
    pv = np.convolve(sp, np.full(10, 0.1))[:n]
    rows = zip(sp.tolist(), pv.tolist(), (sp - pv).tolist(), strict=True)
    return [
        ("plant/L", json.dumps({"t": START + k, "sp": s, "pv": p, "op": o}).encode())
        for k, (s, p, o) in enumerate(rows)
    ]


def one_loop() -> LoopTable:
    return LoopTable([Loop(name="L", kp=1.0, ti=10.0), Loop(name="M")])


def feed(b: Bench, messages: Any, seconds: float = 0.0) -> None:
    for key, payload in messages:
        b.bus.put(key, payload, SENT)
    b.tick(seconds)


def messages_of(loops: Any, block: Any, payload: str, rows: int = 13) -> list[tuple[str, bytes]]:
    """Return what simulated loops publish, frames of so many samples each."""
    out: list[tuple[str, bytes]] = []
    publisher = Publisher(lambda key, data: out.append((key, data)), loops, payload)
    step = rows if payload == "frame" else 2000
    for first in range(0, len(block), step):
        publisher.publish(block.rows(slice(first, first + step)))
    return out
