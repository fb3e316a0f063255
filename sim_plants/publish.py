"""Samples of a simulation to a bus, in step with the clock."""

import math
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from typing import Literal, get_args

import numpy as np

from monitor.contract.loops import default_key
from sim_plants.loops import Block, LoopSpec, Simulation
from sim_plants.payloads import encode_frame, encode_sample, encode_tag, iso_times, name_array

Payload = Literal["tag", "sample", "frame"]

# Loops that share a frame, and most rows of one: a thousand of both costs least per sample on the bus.
_AREA_LOOPS = 1000
_FRAME_ROWS = 1000
# Most samples made at once while catching up: memory stays bounded, and a stop is heard.
_CHUNK_SAMPLES = 200_000
# Pause between two looks at the clock [s]: short against what a trend on a screen shows.
_TICK_S = 0.1
# How long a run without end can stay ahead of real time before it has caught up with the clock [s].
_AHEAD_S = 8 * 3600.0


class Publisher:
    """Puts samples on a bus as one of the payloads.

    Parameters
    ----------
    put : callable
        `put(key, payload)` sends bytes under a key.
    loops : sequence of LoopSpec
        The loops that the blocks count.
    payload : {'tag', 'sample', 'frame'}
        JSON for each quantity under `<loop key>/sp|pv|op|auto`; JSON for each sample under the loop's key;
        Arrow frames under `plant/area<n>/frame`, a thousand loops in an area.

    Raises
    ------
    ValueError
        If `payload` is none of these.
    """

    def __init__(
        self, put: Callable[[str, bytes], None], loops: Sequence[LoopSpec], payload: Payload = "sample"
    ) -> None:
        if payload not in get_args(Payload):
            raise ValueError(f"payload: {payload!r}, expected one of {', '.join(get_args(Payload))}")
        self._put = put
        self._keys = [default_key(loop.name) for loop in loops]
        self._names = name_array([loop.name for loop in loops])
        self._seq = [0] * math.ceil(len(loops) / _AREA_LOOPS)
        self._send = {"tag": self._tags, "sample": self._samples, "frame": self._frames}[payload]
        self.messages = 0
        """Messages put so far."""

    def publish(self, block: Block) -> None:
        """Put the samples of a block, in its order."""
        for key, payload in self._send(block):
            self._put(key, payload)
            self.messages += 1

    def _tags(self, block: Block) -> Iterator[tuple[str, bytes]]:
        # PV comes last: a sample is made at its time, of the others' values at or before it.
        columns = (block.sp.tolist(), block.op.tolist(), block.auto.astype(float).tolist(), block.pv.tolist())
        for loop, stamp, *values in zip(block.loop.tolist(), iso_times(block.time_ns), *columns, strict=True):
            for name, value in zip(("sp", "op", "auto", "pv"), values, strict=True):
                payload = encode_tag(value, stamp)
                if payload is not None:
                    yield f"{self._keys[loop]}/{name}", payload

    def _samples(self, block: Block) -> Iterator[tuple[str, bytes]]:
        columns = (block.sp.tolist(), block.pv.tolist(), block.op.tolist(), block.auto.tolist())
        for loop, stamp, *values in zip(block.loop.tolist(), iso_times(block.time_ns), *columns, strict=True):
            yield self._keys[loop], encode_sample(stamp, *values)

    def _frames(self, block: Block) -> Iterator[tuple[str, bytes]]:
        areas = block.loop // _AREA_LOOPS
        for area in np.unique(areas).tolist():
            part = block.rows(areas == area) if len(self._seq) > 1 else block
            for first in range(0, len(part), _FRAME_ROWS):
                frame = encode_frame(
                    self._names, part.rows(slice(first, first + _FRAME_ROWS)), self._seq[area]
                )
                self._seq[area] += 1
                yield f"plant/area{area + 1}/frame", frame


def start_time(now: float, speed: float, seconds: float | None) -> float:
    """Return where a simulation has to start so that none of its samples will lie in the future.

    Parameters
    ----------
    now : float
        The present [s since 1970 UTC].
    speed : float
        Simulated seconds per second; above 1 the start lies in the past.
    seconds : float or None
        For how long it will run by the clock; None for ever, where it falls back to real time when it has
        caught up after eight hours [s].
    """
    ahead = _AHEAD_S if seconds is None else seconds
    return now - max(speed - 1.0, 0.0) * ahead


def run(
    simulation: Simulation,
    publisher: Publisher,
    speed: float = 1.0,
    seconds: float | None = None,
    stop: threading.Event | None = None,
    *,
    monotonic: Callable[[], float] = time.monotonic,
    now: Callable[[], float] = time.time,
    wait: Callable[[float], object] | None = None,
) -> None:
    """Publish in step with the clock until `stop` is set or `seconds` are over.

    Nothing is skipped: what a slow bus holds up is made up for. No sample lies in the future: a simulation
    that has caught up with the present goes on in real time.

    Parameters
    ----------
    simulation : Simulation
        It should start at `start_time`.
    publisher : Publisher
        Where its samples go.
    speed : float
        Simulated seconds per second, above 0.
    seconds : float or None
        For how long, by the clock; None for ever [s].
    stop : threading.Event or None
        Ends the run.
    monotonic, now, wait : callable
        Clock that never jumps [s], time of day [s since 1970 UTC], pause [s].

    Raises
    ------
    ValueError
        If `speed` is not a number above 0.
    """
    if not (math.isfinite(speed) and speed > 0):
        raise ValueError(f"speed: {speed!r}, expected a number above 0")
    stop = stop or threading.Event()
    wait = wait or stop.wait
    chunk = _CHUNK_SAMPLES / simulation.rate
    begin, origin = monotonic(), simulation.time_ns
    while not stop.is_set():
        passed = monotonic() - begin
        over = seconds is not None and passed >= seconds
        wanted = origin * 1e-9 + min(passed, seconds if seconds is not None else math.inf) * speed
        # A microsecond less, which is what times are rounded to: none may lie in the future.
        behind = min(wanted, now()) - simulation.time_ns * 1e-9 - 1e-6
        if behind > 0:
            publisher.publish(simulation.advance(min(behind, chunk)))
        if behind <= chunk:
            if over:
                return
            wait(_TICK_S)
