"""A monitor that is killed again and again: `python -m tests.bench.kills --kills 100 --speed 100`.

A plant of thirteen loops goes on over real Zenoh, whatever becomes of the monitor. SIGKILL comes at random instants;
the next process starts at once. Prints what was published, stored and assessed, and in how many of the restarts a
loop's verdict, settings, suggestion or flags were other ones than before.
"""

from __future__ import annotations

import argparse
import json
import random
import signal
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path
from typing import Any

from monitor.adapters.zenoh_bus import ask, open_session, plant_put
from sim_plants.export import write_rows
from sim_plants.loops import Simulation
from sim_plants.publish import Publisher
from sim_plants.scenarios import SCENARIOS
from sim_plants.truth import loop_table
from tests.support.stores import stored
from tests.support.waiting import free_port

TOLD = ("verdict", "kp", "ti", "new_kp", "new_ti", "process", "flags")
"""What must be the same after a restart in which no event was assessed."""
SAID = b'{"kp": 1.25}'
"""Settings that are sent once, and never again, to the first loop."""


class Plant(threading.Thread):
    """Publishes frames of simulated seconds, so many in a second, until told to stop."""

    def __init__(self, put: Any, loops: Any, speed: float) -> None:
        super().__init__(daemon=True)
        self.over = threading.Event()
        self._simulation = Simulation(loops, time.time() - 30 * 86_400)
        self._publisher = Publisher(put, loops, "frame")
        self._speed = speed

    def run(self) -> None:
        """Advance ten times a second."""
        while not self.over.wait(0.1):
            self._publisher.publish(self._simulation.advance(max(self._speed / 10.0, 0.1)))


def rows_of(session: Any) -> dict[str, dict[str, Any]]:
    """Return what the monitor says of each loop; empty where it does not answer."""
    replies = [json.loads(payload) for _, payload in ask(session, "loopsight/plant/*/status", 5.0)]
    return {row["loop"]: row for row in replies}


def start(endpoint: str, folder: Path) -> subprocess.Popen[str]:
    """Start a monitor; return when it is ready."""
    line = [
        sys.executable,
        "-m",
        "monitor",
        "monitor",
        "--connect",
        endpoint,
        "--state",
        str(folder / "state"),
    ]
    with (folder / "log").open("a") as log:
        process = subprocess.Popen(
            [*line, "--loops", str(folder / "loops.csv")], stdout=subprocess.PIPE, stderr=log, text=True
        )
    assert process.stdout is not None
    process.stdout.readline()
    return process


def changed(before: dict[str, Any], after: dict[str, Any]) -> list[str]:
    """Name the loops of which something else is said, though no event was assessed meanwhile."""
    for row in [*before.values(), *after.values()]:
        row["flags"] = [
            flag for flag in row["flags"] if flag != "stale"
        ]  # of today's samples, not of what is known
    return [
        f"{name}: {what} {before[name][what]!r} -> {row[what]!r}"
        for name, row in after.items()
        if name in before and before[name]["events"] == row["events"] > 0
        for what in TOLD
        if before[name][what] != row[what]
    ]


def main() -> None:
    """Kill, compare, print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--kills", type=int, default=20)
    parser.add_argument("--speed", type=float, default=100.0)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    chance = random.Random(options.seed)
    heard: dict[str, list[Any]] = {}
    other: list[str] = []
    endpoint, loops = f"tcp/127.0.0.1:{free_port()}", SCENARIOS["demo"](options.seed)
    router = open_session("router", listen=[endpoint])
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        write_rows(folder / "loops.csv", loop_table(loops))
        router.declare_subscriber(
            "loopsight/**/assessment",
            lambda s: heard.setdefault(json.loads(s.payload.to_bytes())["id"], []).append(
                s.payload.to_bytes()
            ),
        )
        put = plant_put(router)
        plant = Plant(put, loops, options.speed)
        plant.start()
        process = start(endpoint, folder)
        put(f"plant/{loops[0].name}/settings", SAID)
        for _ in range(options.kills):
            time.sleep(chance.uniform(0.5, 5.0))
            before = rows_of(router)
            process.send_signal(signal.SIGKILL)
            process.wait()
            process = start(endpoint, folder)
            other += changed(before, rows_of(router))
        last = rows_of(router)
        plant.over.set()
        plant.join()
        process.terminate()
        code = process.wait()
        kept, events = stored(folder / "state"), stored(folder / "state", "event")
        said = {
            identity: {json.dumps(json.loads(p), sort_keys=True) for p in all_}
            for identity, all_ in heard.items()
        }
        closed = {i for i, e in events.items() if e["kind"] == "setpoint" and e["end"] is not None}
        twice = sum(len(versions) > 1 for versions in said.values())
        print(f"{options.kills} kills at {options.speed:g} times real time, exit code at the end {code}")
        print(
            f"assessments stored {len(kept)}, published {len(said)}, only stored {len(kept.keys() - said.keys())},"
        )
        print(f"only published {len(said.keys() - kept.keys())}, published in two versions {twice}")
        print(f"events stored {len(events)}, open {sum(e['state'] == 'open' for e in events.values())},")
        print(f"closed with an end and not assessed {len(closed - kept.keys())}")
        print(f"settings sent once: kp {last[loops[0].name]['kp']}, at the end of {options.kills} restarts")
        print(f"said otherwise after a restart: {len(other)}")
        for line in other[:10]:
            print(f"  {line}")
    router.close()


if __name__ == "__main__":
    main()
