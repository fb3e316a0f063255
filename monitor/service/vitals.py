"""How a running monitor is, for other threads: what the last completed tick left, never the engine itself.

``/livez``: ticks are completed; ``/readyz``: what comes in is heard and what is found is kept, or why not, a line for
each reason; ``/metrics``: all that is counted.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from http import HTTPStatus

from monitor.adapters.http import Answer
from monitor.adapters.store import StoreError
from monitor.contract.status import NOT_READY, Status

from .every import Every
from .metrics import METRICS_MIME, Metrics
from .service import Service

LIVE_WITHIN_S = 60.0
"""Without a completed tick, after which a monitor counts as dead: the longest seen are seconds [s]."""
LOOK_EVERY_S = 1.0
"""Between two looks at how things stand: they go through all loops [s]."""
TEXT_MIME = "text/plain; charset=utf-8"


class Vitals:
    """Takes note after each tick; answers at any time.

    Parameters
    ----------
    monotonic
        [s]
    """

    def __init__(self, monotonic: Callable[[], float] = time.monotonic) -> None:
        self._monotonic = monotonic
        self._ticked: float | None = None
        self._look = Every(LOOK_EVERY_S)
        self._status: Status | None = None
        self._store_bytes = 0
        self._metrics = Metrics()

    def beat(self, service: Service, seconds: float) -> None:
        """Take note of a tick that was completed just now, after so long [s]; called by the thread that ticks."""
        now = self._ticked = self._monotonic()
        self._metrics.ticked(seconds)
        if self._look.due(now):
            self._status = service.status()
            with suppress(StoreError):  # that it fails is told as the reason why it is not ready
                self._store_bytes = service.store.size

    @property
    def answers(self) -> Mapping[str, Callable[[], Answer]]:
        """What is answered, by path."""
        return {"/livez": self.live, "/readyz": self.ready, "/metrics": self.metrics}

    def live(self) -> Answer:
        """Answer whether ticks are completed; before the first one it is live, however long the kernels take."""
        return _lines(self._stalled(), "live")

    def ready(self) -> Answer:
        """Answer whether the monitor does its work, with every reason why not."""
        status = self._status
        why = ["starting"] if status is None else [f"{why}: {NOT_READY[why]}" for why in status.not_ready]
        return _lines([*self._stalled(), *why], "ready")

    def metrics(self) -> Answer:
        """Answer with all that is counted, as Prometheus reads it."""
        return HTTPStatus.OK, METRICS_MIME, self._metrics.text(self._status, self._age(), self._store_bytes)

    def _age(self) -> float | None:
        """Time since the last completed tick [s]; None before the first one."""
        return None if self._ticked is None else self._monotonic() - self._ticked

    def _stalled(self) -> list[str]:
        if (age := self._age()) is None or age <= LIVE_WITHIN_S:
            return []
        return [f"stalled: no tick for {age:.0f} s, expected one within {LIVE_WITHIN_S:.0f} s"]


def _lines(reasons: list[str], fine: str) -> Answer:
    code = HTTPStatus.SERVICE_UNAVAILABLE if reasons else HTTPStatus.OK
    return code, TEXT_MIME, ("\n".join(reasons or [fine]) + "\n").encode()
