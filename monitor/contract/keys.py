"""Keys on the bus: what the monitor says and answers, all under one prefix; ``@`` holds what concerns itself.

In place of a loop, an event or a monitor, ``*`` is any one and ``**`` (loops only) any at all. ``@`` is a verbatim
chunk in Zenoh: no wildcard matches it, so whoever wants both asks for both.
"""

from __future__ import annotations

PREFIX = "loopsight"
"""The only key space that a monitor ever writes to."""
LOOPS = f"{PREFIX}/**"
"""All that is said and answered of loops."""


def of_loop(loop: str, leaf: str) -> str:
    """Return ``loopsight/<loop key>/<leaf>``.

    Parameters
    ----------
    loop
        The loop's key, e.g. ``plant/LIC-101``.
    leaf
        ``event``, ``assessment``, ``suggestion``, ``window``, ``trend`` or ``status``.

    Examples
    --------
    >>> of_loop("plant/LIC-101", "event")
    'loopsight/plant/LIC-101/event'
    """
    return f"{PREFIX}/{loop}/{leaf}"


def event(loop: str) -> str:
    """Return where a loop's events open and close."""
    return of_loop(loop, "event")


def assessment(loop: str) -> str:
    """Return where a loop's events are judged."""
    return of_loop(loop, "assessment")


def suggestion(loop: str) -> str:
    """Return where new settings of a loop are suggested."""
    return of_loop(loop, "suggestion")


def trend(loop: str) -> str:
    """Return where a loop's samples are published for the eye."""
    return of_loop(loop, "trend")


def status(loop: str) -> str:
    """Return where a loop's current row is asked for."""
    return of_loop(loop, "status")


def window(loop: str, event_id: str = "") -> str:
    """Return where an event's evidence is published, and, with its id, asked for."""
    return of_loop(loop, f"window/{event_id}" if event_id else "window")


def history(loop: str, event_id: str) -> str:
    """Return where a stored assessment is asked for.

    Examples
    --------
    >>> history("plant/*", "*")
    'loopsight/plant/*/history/*'
    """
    return of_loop(loop, f"history/{event_id}")


def of_monitor(monitor: str) -> str:
    """Return all that concerns a monitor itself.

    Examples
    --------
    >>> of_monitor("demo")
    'loopsight/@/demo/**'
    """
    return f"{PREFIX}/@/{monitor}/**"


def monitor_status(monitor: str) -> str:
    """Return where a monitor's health is published and asked for."""
    return f"{PREFIX}/@/{monitor}/status"


def monitor_instance(monitor: str, instance: str) -> str:
    """Return the liveliness token of one process among those that call themselves by a monitor's name."""
    return f"{PREFIX}/@/{monitor}/instance/{instance}"


def monitor_alive(monitor: str) -> str:
    """Return the liveliness token of a monitor."""
    return f"{PREFIX}/@/{monitor}/alive"


def monitor_command(monitor: str) -> str:
    """Return where a monitor is asked to do something."""
    return f"{PREFIX}/@/{monitor}/command"
