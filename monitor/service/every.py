"""What is done every so often: asked at each tick, due at some."""

from __future__ import annotations


class Every:
    """A deadline that moves on when it is met.

    Parameters
    ----------
    seconds
        Between two times that it is due, counted from when it was found so [s].
    first
        When it is due for the first time [s, monotonic]; the default: at the first tick.

    Examples
    --------
    >>> minute = Every(60.0, first=0.0)
    >>> [now for now in (0.0, 10.0, 59.0, 61.0, 120.0, 121.0) if minute.due(now)]
    [0.0, 61.0, 121.0]
    """

    def __init__(self, seconds: float, first: float = float("-inf")) -> None:
        self.seconds = seconds
        self._next = first

    def due(self, now: float) -> bool:
        """Whether it is time [s, monotonic]; the next time is then as many seconds away."""
        if now < self._next:
            return False
        self._next = now + self.seconds
        return True

    def hasten(self, now: float) -> None:
        """Make it due at ``now`` [s, monotonic], earlier than planned."""
        self._next = min(self._next, now)

    def postpone(self, until: float) -> None:
        """Make it due at ``until`` [s, monotonic] and not before."""
        self._next = until
