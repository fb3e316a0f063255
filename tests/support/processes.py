"""Processes that a test has started: their children, and whether they have ended."""

from __future__ import annotations

import psutil


def children(pid: int) -> list[int]:
    """Ids of a process's children."""
    return [child.pid for child in psutil.Process(pid).children()]


def gone(pid: int) -> bool:
    """Whether a process has ended, as a zombie at most."""
    try:
        return bool(psutil.Process(pid).status() == psutil.STATUS_ZOMBIE)
    except psutil.NoSuchProcess:
        return True
