"""What all commands share: one style of error, the version, being told to stop."""

from __future__ import annotations

import os
import signal
import threading
from typing import Any

import click

STOP_WITHIN = 9.0
"""Seconds between being told to stop and a hard end: nothing may keep a service manager waiting."""


class Refused(click.ClickException):
    """An error of the user's: one line, exit 2."""

    exit_code = 2


def _version(ctx: click.Context, _param: click.Parameter, value: bool) -> None:
    if value:
        from importlib.metadata import version

        click.echo(f"loopsight {version('loopsight')}")
        ctx.exit()


def version_option() -> click.Option:
    """Return the option that every command has."""
    return click.Option(
        ["--version"],
        is_flag=True,
        is_eager=True,
        expose_value=False,
        callback=_version,
        help="Show the version.",
    )


def until_told() -> threading.Event:
    """Return an event that SIGTERM and SIGINT set; STOP_WITHIN later the process ends, whatever hangs."""
    stop = threading.Event()

    def tell(*_: Any) -> None:
        if not stop.is_set():
            deadline = threading.Timer(STOP_WITHIN, os._exit, (1,))
            deadline.daemon = True
            deadline.start()
        stop.set()

    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, tell)
    return stop
