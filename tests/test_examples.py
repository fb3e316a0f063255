"""Every program in examples/ does what it shows."""

from __future__ import annotations

import importlib.util
import subprocess
import sys
import threading
import time
from pathlib import Path

from monitor.adapters.zenoh_bus import open_session
from monitor.contract.entries import Message
from monitor.contract.loops import Loop, LoopTable
from monitor.wire.decode import Decoder
from sim_plants.export import write_export
from sim_plants.scenarios import SCENARIOS
from tests.support.places import ROOT
from tests.support.waiting import free_port

EXAMPLES = ROOT / "examples"
KNOWN = {
    "audit_in_ten_lines.py",
    "engine_on_dataframe.py",
    "gateway_publisher.py",
    "tuning_rule_on_model.py",
}


def run(name: str, *arguments: object, cwd: Path) -> str:
    """Run an example as a user does, from another folder; return what it prints."""
    command = [sys.executable, str(EXAMPLES / name), *map(str, arguments)]
    done = subprocess.run(command, cwd=cwd, capture_output=True, text=True, timeout=1800, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


def loaded(name: str):
    """Import an example."""
    spec = importlib.util.spec_from_file_location(name.removesuffix(".py"), EXAMPLES / name)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_every_example_is_tested():
    """A new example needs a test here."""
    assert {file.name for file in EXAMPLES.glob("*.py")} == KNOWN


def test_audit_in_ten_lines(tmp_path):
    """It prints each loop with its verdict, and has no more than ten lines of code."""
    write_export(SCENARIOS["pumped-tank"](1), 1500.0, tmp_path / "export")
    files = (tmp_path / "export" / "data.parquet", tmp_path / "export" / "loops.csv")
    said = run("audit_in_ten_lines.py", *files, tmp_path / "audit", cwd=tmp_path)
    assert {line.split()[0] for line in said.splitlines()} == {f"LIC-101-{n}" for n in ("PI", "PID", "PIDF")}
    assert (tmp_path / "audit" / "loops.csv").exists()
    text = (EXAMPLES / "audit_in_ten_lines.py").read_text(encoding="utf-8").split("\n", 4)[-1]
    code = [line for line in text.splitlines() if line and not line.startswith(("import", "from"))]
    assert len(code) <= 10


def test_engine_on_dataframe(tmp_path):
    """The simulated tank is found to be slow, and its process what was simulated."""
    module = loaded("engine_on_dataframe.py")
    found, row = module.watch(module.tank(), module.TODAY)
    assessment = found[0]
    assert assessment.gain_lo < 0.05 < assessment.gain_hi
    assert assessment.dead_time_lo < 4.0 < assessment.dead_time_hi
    assert row.verdict == "retune"
    assert row.new_kp > 1.0
    assert "LIC-101: retune; set kp" in run("engine_on_dataframe.py", cwd=tmp_path)


def test_tuning_rule_on_model(tmp_path):
    """Settings with their robustness, and the fields of a block."""
    said = run("tuning_rule_on_model.py", cwd=tmp_path)
    assert "kp = 2.5, ti = 32 s, td = 3 s" in said
    assert "Ms = 1.79" in said
    assert "RESET = 32 s/repeat" in said


def test_gateway_publisher():
    """A monitor's decoder reads every sample of what arrives on loopback."""
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    module = loaded("gateway_publisher.py")
    heard: list[Message] = []
    enough = threading.Event()

    def hear(sample):
        heard.append(Message(str(sample.key_expr), sample.payload.to_bytes(), 0))
        if len(heard) >= 3:
            enough.set()

    with open_session("router", listen=[endpoint]) as session:
        subscriber = session.declare_subscriber("plant/**", hear)
        for _ in range(60):  # on a busy machine the first frames may go before the router knows who listens
            assert module.publish(endpoint, seconds=0.5, period=0.05) >= 1
            if enough.is_set():
                break
        subscriber.undeclare()
    decoder = Decoder(LoopTable([Loop(name=name) for name in module.LOOPS]))
    entries = decoder.decode(heard[:3], latest=time.time_ns())
    assert not decoder.causes
    assert len(entries) == 3 * len(module.LOOPS)
