"""How the loops run: samples in, records out. Each folder is a station on the data's way, in this order.

- ``compiled``: how the hot loops are compiled;
- ``contract``: what crosses a threshold: samples, loops, entries, records, evidence, times, text;
- ``health``: each sample to a loop's condition;
- ``detect``: samples to events;
- ``identify``: an event's window to a process model with intervals;
- ``assess``: model and event to index, evidence and the verdict on the tuning;
- ``advise``: model and verdict to safe settings, or the reason for none;
- ``verdict``: all that is known of a loop to its one row;
- ``engine``: owns the state of all these; samples in, records out;
- ``wire``: bytes to entries, records to bytes, and back;
- ``adapters``: one outside library each;
- ``report``: an audit's facts to one HTML page;
- ``service, audit, view, check``: the drivers;
- ``cli``: options, one line for each error, exit codes.

From ``health`` to ``engine`` nothing knows a clock, a file, a socket, a thread or a log, and each imports only what
stands before it (``detect`` may use ``health``). What a program of one's own needs can be had from here:

>>> from monitor import Engine, Loop, LoopTable, Samples
>>> engine = Engine(LoopTable([Loop(name="LIC-101", kp=2.0, ti=120.0)]))
>>> engine.step(Samples.of(0, [0, 10**9], sp=50.0, pv=[50.0, 50.1], op=30.0))
[]
"""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from monitor.adapters.loop_table import read_loop_table
    from monitor.audit.run import run_audit
    from monitor.audit.settings import AuditSettings
    from monitor.contract.evidence import Window
    from monitor.contract.loops import Loop, LoopTable
    from monitor.contract.records import Assessment, Event, LoopRow, Suggestion
    from monitor.contract.samples import Samples
    from monitor.engine import Engine

__all__ = [
    "Assessment",
    "AuditSettings",
    "Engine",
    "Event",
    "Loop",
    "LoopRow",
    "LoopTable",
    "Samples",
    "Suggestion",
    "Window",
    "read_loop_table",
    "run_audit",
]

_HOMES = {
    "Assessment": "contract.records",
    "AuditSettings": "audit.settings",
    "Engine": "engine",
    "Event": "contract.records",
    "Loop": "contract.loops",
    "LoopRow": "contract.records",
    "LoopTable": "contract.loops",
    "Samples": "contract.samples",
    "Suggestion": "contract.records",
    "Window": "contract.evidence",
    "read_loop_table": "adapters.loop_table",
    "run_audit": "audit.run",
}
"""Imported when first asked for, so that ``import monitor``, and with it ``loopsight --help``, costs nothing."""


def __getattr__(name: str) -> object:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    found = getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)
    globals()[name] = found
    return found


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
