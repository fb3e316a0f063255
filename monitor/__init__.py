"""How the loops run: samples in, records out.

The folders are the stations of the data's one way; each imports only what stands before it. ``compiled`` (numba's
decorator) and ``contract`` (what crosses a threshold); ``health, detect, identify, assess, advise, verdict, engine``
(pure: no clock, no file, no socket); ``wire`` (bytes) and ``adapters`` (one outside library each); the drivers
``service, audit, view, check``; and ``cli``.

The names that most programs need are here: ``from monitor import Engine, Loop, LoopTable, Samples``. Nothing heavy is
imported until one of them is asked for.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .contract.evidence import Window
    from .contract.loops import Loop, LoopTable
    from .contract.records import Assessment, Event, LoopRow, Suggestion
    from .contract.samples import Samples
    from .engine import Engine

_HOMES = {
    "Assessment": "contract.records",
    "Engine": "engine",
    "Event": "contract.records",
    "Loop": "contract.loops",
    "LoopRow": "contract.records",
    "LoopTable": "contract.loops",
    "Samples": "contract.samples",
    "Suggestion": "contract.records",
    "Window": "contract.evidence",
}
__all__ = ["Assessment", "Engine", "Event", "Loop", "LoopRow", "LoopTable", "Samples", "Suggestion", "Window"]


def __getattr__(name: str) -> Any:
    """Import a name when it is asked for."""
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)
