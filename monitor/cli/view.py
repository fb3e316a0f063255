"""``loopsight view``: a live monitor, one event of its history, an audit, or a recording, in Rerun."""

from __future__ import annotations

import re
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from .common import Command, Failed, Refused, parent_option, zenoh_option

if TYPE_CHECKING:
    from monitor.view.drawing import Draw

ENDPOINT = "tcp/127.0.0.1:7447"
AUDIT_FILE = "audit.json"
"""In the folder of any audit."""


@click.command(cls=Command, epilog="Example: loopsight view --connect tcp/127.0.0.1:7447 --save today.rrd")
@click.argument("file", metavar="[FILE.rrd|AUDIT_DIR]", required=False, type=click.Path(path_type=Path))
@click.option("--connect", metavar="ENDPOINT", help=f"Zenoh endpoint of a running monitor, e.g. {ENDPOINT}.")
@click.option("--event", metavar="ID", help="Show this one event of the monitor's history.")
@click.option(
    "--state",
    metavar="DIR",
    type=click.Path(exists=True, file_okay=False, path_type=Path),
    help="Take the event from this folder of a monitor that does not run.",
)
@click.option(
    "--view",
    "how",
    type=click.Choice(["web", "native", "none"]),
    default="web",
    show_default=True,
    help="Where to show it: a local web page, a window, or nowhere (with --save).",
)
@click.option("--save", type=click.Path(dir_okay=False, path_type=Path), help="Record into this .rrd file.")
@click.option("--open", "browser", is_flag=True, help="Open the web page in the default browser.")
@zenoh_option
@parent_option
def view(
    file: Path | None,
    connect: str | None,
    event: str | None,
    state: Path | None,
    parent: int | None,
    **wanted: Any,
) -> None:
    """Look at flagged loops in Rerun: live, one event, an audit, or a recording.

    Prints one line with the address to open. Everything stays on this machine's loopback interface.
    """
    _check(file, connect, event, wanted["how"], wanted["save"])
    if state is not None and (connect or not event):
        raise Refused("--state DIR goes with --event ID, and with no --connect")
    from monitor.adapters.process import Stop
    from monitor.view.drawing import ViewError
    from monitor.view.process import LAST_WORD_S
    from monitor.view.run import Wanted, look_back, show, watch

    what = Wanted(event=event or "", **wanted)
    with Stop(LAST_WORD_S, 0, parent) as stop:
        try:
            if state is not None:
                look_back(partial(_stored, state, what.event), what, stop)
            elif file is None:
                watch(connect or ENDPOINT, what, stop)
            elif file.is_dir():
                look_back(partial(_audit, file), what, stop)
            else:
                show(file, what, stop)
        except ViewError as error:
            raise Failed(str(error)) from None
        except (ValueError, OSError) as error:
            raise Refused(str(error)) from None


def _audit(folder: Path) -> Draw:
    """Read the audit in a folder; return what draws it."""
    from monitor.audit.drawing import contents_of
    from monitor.view.recorded import draw_audit

    return partial(draw_audit, contents_of(folder))


def _stored(folder: Path, event: str) -> Draw:
    """Read an event out of a monitor's state folder; return what draws it."""
    from monitor.view.stored import stored_event

    return stored_event(folder, event)


def _check(file: Path | None, connect: str | None, event: str | None, how: str, save: Path | None) -> None:
    """Refuse what does not go together, and what is none."""
    if file is not None:
        if connect or event:
            raise Refused("FILE.rrd and AUDIT_DIR go with --view, --save and --open only")
        (_check_audit if file.is_dir() else _check_recording)(file)
        if save and not file.is_dir():
            raise Refused(f"--save: {file} is a recording already")
    elif not connect and not event:
        raise Refused("what to view? Give FILE.rrd, AUDIT_DIR, --connect ENDPOINT or --event ID")
    if how == "none" and save is None:
        raise Refused("--view none shows nothing: give --save FILE.rrd with it")
    if event and not re.fullmatch(r"[0-9A-Za-z_-]{1,64}", event):
        raise Refused(f"--event {event!r} is no event's id")
    if save is not None and not save.parent.is_dir():
        raise Refused(f"--save {save}: no such folder")
    if connect and not re.fullmatch(r"[a-z]+/[^\s/]+(/.*)?", connect):
        raise Refused(f"--connect {connect!r} is no endpoint such as {ENDPOINT}")


def _check_audit(folder: Path) -> None:
    if not (folder / AUDIT_FILE).is_file():
        raise Refused(f"{folder}: no {AUDIT_FILE}, expected the folder of an audit (--out)")


def _check_recording(file: Path) -> None:
    try:
        with file.open("rb") as f:
            magic = f.read(3)
    except OSError as error:
        raise Refused(f"{file}: {error.strerror}") from error
    if magic != b"RRF":
        raise Refused(f"{file}: not a Rerun recording")
