"""The rehearsal leaves nothing for a compiler to do."""

from __future__ import annotations

import subprocess
import sys
import time

import pytest

from monitor.service.warm_up import warm_up
from tests.support.places import ROOT


def test_warm_up_compiles_everything():
    """After it the first step of a loop does not wait for a compiler."""
    warm_up()
    began = time.thread_time()
    warm_up()
    assert time.thread_time() - began < 5.0


NEW_TYPES = """
import sys, tempfile
from pathlib import Path
from numba.core.dispatcher import Dispatcher
from monitor.contract.loops import LoopTable
from monitor.service.warm_up import warm_up
from sim_plants.loops import Simulation
from sim_plants.scenarios import SCENARIOS
from tests.monitor.service.test_service import START, messages_of
from tests.monitor.service.tools import SENT, Bench
from tests.support.plants import table_of

def known():
    ours = [m for n, m in list(sys.modules.items()) if n.startswith("monitor.")]
    compiled = {f for m in ours for f in vars(m).values() if isinstance(f, Dispatcher)}
    return {(f.py_func.__module__, f.py_func.__name__, str(s)) for f in compiled for s in f.signatures}

warm_up()
before = known()
specs = SCENARIOS["demo"](1)
block = Simulation(specs, START).advance(1500)
with tempfile.TemporaryDirectory() as folder:
    bench = Bench(Path(folder), LoopTable(table_of(specs)))
    for k, message in enumerate(messages_of(specs, block, "frame")):
        bench.bus.put(*message, SENT)
        if k % 20 == 0:
            bench.tick(1.0)
    bench.service.finish()
    bench.store.close()
for module, name, types in sorted(known() - before):
    print(module, name, types)
"""


@pytest.mark.slow
def test_no_event_of_the_demo_waits_for_a_compiler():
    """What the demo's loops make the service call, with the types that they bring, has been called before."""
    done = subprocess.run(
        [sys.executable, "-c", NEW_TYPES], cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout == ""
