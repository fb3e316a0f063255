"""Driver of the view: a process of its own that shows in Rerun what the monitor says, live or recorded.

It is a client of the monitor's Zenoh session and may stall or die without the monitor noticing.
"""

from __future__ import annotations

import contextlib
import os
import re
import subprocess
import sys
import threading
import webbrowser
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from monitor.adapters.process import Stop, end

if TYPE_CHECKING:
    from monitor.adapters.rerun_view.picture import Picture
    from monitor.adapters.rerun_view.process import RerunProcess

ENDPOINT = "tcp/127.0.0.1:7447"
TICK = 0.25
"""Seconds between two looks into the inbox: fast for an eye, nothing for a processor."""
LAST_WORD = 5.0
"""How long the end may take [s] before the process ends itself by force."""
PATIENCE = 30.0
"""How long a child may take to say where it can be seen [s]."""


class ViewProcess:
    """A view in a child process of its own. It ends with this process."""

    def __init__(self, process: subprocess.Popen[str]) -> None:
        self._process = process
        self._said = threading.Event()
        self._line = ""
        self._reader = threading.Thread(target=self._read, name="view-output", daemon=True)
        self._reader.start()

    @property
    def pid(self) -> int:
        """Id of the process."""
        return self._process.pid

    @property
    def url(self) -> str:
        """Where to look: an address for a browser, or empty where there is none. Waits until it is known."""
        self._said.wait(PATIENCE)
        words = self._line.split()
        return words[1] if len(words) > 1 and words[1].startswith(("http:", "rerun+http:")) else ""

    def alive(self) -> bool:
        """Whether the view still runs."""
        return self._process.poll() is None

    def stop(self, within: float = LAST_WORD + 3.0) -> None:
        """End the view and what it has started, by force after ``within`` [s]. Harmless twice."""
        end(self._process, within)
        self._reader.join(1.0)

    def _read(self) -> None:
        with self._process.stdout or open(os.devnull) as out:  # noqa: PTH123 - no path, a stream
            for line in out:
                if line.startswith("view ") and not self._said.is_set():
                    self._line = line.strip()
                    self._said.set()
        self._said.set()


def start_view(endpoint: str, view: str = "web", save: Path | None = None) -> ViewProcess:
    """Start a view of the monitor at ``endpoint`` as a child process; returns at once.

    Parameters
    ----------
    endpoint
        Zenoh endpoint of the monitor, e.g. ``tcp/127.0.0.1:7447``.
    view
        ``web``, ``native`` or ``none`` (only with ``save``).
    save
        Record into this file.

    Raises
    ------
    OSError
        The process cannot be started.
    """
    command = [sys.executable, "-m", "monitor.view.process", "--connect", endpoint, "--view", view]
    command += ["--parent", str(os.getpid())] + (["--save", str(save)] if save else [])
    process = subprocess.Popen(  # noqa: S603 - our own program and arguments
        command,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        text=True,
        start_new_session=True,  # Ctrl-C is for the parent, which stops the view in its own order
    )
    return ViewProcess(process)


@click.command(
    "view",
    epilog="Example: loopsight view --connect tcp/127.0.0.1:7447 --save today.rrd",
    context_settings={"help_option_names": ["-h", "--help"]},
)
@click.argument("file", metavar="[FILE.rrd]", required=False, type=click.Path(path_type=Path))
@click.option("--connect", metavar="ENDPOINT", help=f"Zenoh endpoint of a running monitor, e.g. {ENDPOINT}.")
@click.option("--event", metavar="ID", help="Show this one event of the monitor's history.")
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
@click.option(
    "--parent", type=int, hidden=True, help="End when the process with this id is no longer our parent."
)
def view_command(
    file: Path | None,
    connect: str | None,
    event: str | None,
    how: str,
    save: Path | None,
    browser: bool,
    parent: int | None,
) -> None:
    """Look at flagged loops in Rerun: live, one event, or a recording.

    Prints one line with the address to open. Everything stays on this machine's loopback interface.
    """
    if file is not None:
        if connect or event or save:
            raise click.UsageError("FILE.rrd goes with --view and --open only")
        _check_recording(file)
    elif not connect and not event:
        raise click.UsageError("what to view? Give FILE.rrd, --connect ENDPOINT or --event ID")
    if how == "none" and (file is not None or save is None):
        raise click.UsageError("--view none shows nothing: give --save FILE.rrd with it")
    if event and not re.fullmatch(r"[0-9A-Za-z_-]{1,64}", event):
        raise click.UsageError(f"--event {event!r} is no event's id")
    if save is not None and not save.parent.is_dir():
        raise click.UsageError(f"--save {save}: no such folder")
    if connect and not re.fullmatch(r"[a-z]+/[^\s/]+(/.*)?", connect):
        raise click.UsageError(f"--connect {connect!r} is no endpoint such as {ENDPOINT}")
    with Stop(LAST_WORD, 0, parent) as stop:
        if file is not None:
            _show(file, how, browser, stop)
        else:
            _watch(connect or ENDPOINT, event, how, save, browser, stop)


def run(arguments: list[str]) -> int:
    """Run ``view`` by itself and return the exit code: errors are one line on stderr; 2 on wrong use."""
    try:
        view_command.main(arguments, standalone_mode=False, prog_name="loopsight view")
    except click.ClickException as error:
        click.echo(f"loopsight view: {' '.join(error.format_message().split())}", err=True)
        return error.exit_code
    except (click.Abort, KeyboardInterrupt):
        pass
    return 0


def main() -> None:
    """Run ``view`` as a process of its own."""
    sys.exit(run(sys.argv[1:]))


def _check_recording(file: Path) -> None:
    try:
        with file.open("rb") as f:
            magic = f.read(3)
    except OSError as error:
        raise click.UsageError(f"{file}: {error.strerror}") from error
    if magic != b"RRF":
        raise click.UsageError(f"{file}: not a Rerun recording")


def _show(file: Path, how: str, browser: bool, stop: Stop) -> None:
    viewer = _viewer(how, file)
    if viewer is None:
        return
    try:
        _announce(viewer, browser)
        while viewer.alive() and not stop.wait(TICK):
            pass
    finally:
        stop.set()
        viewer.stop()


def _viewer(how: str, file: Path | None = None) -> RerunProcess | None:
    """Start what shows the picture; started before all else, since it is forked."""
    from monitor.adapters.rerun_view import process  # noqa: PLC0415 - --help answers at once

    try:
        if how == "none":
            process.program()
            return None
        if how == "native":
            if process.has_display():
                try:
                    return process.open_native(file)
                except process.RerunError as error:
                    click.echo(f"no window ({error}): showing the web page instead", err=True)
            else:
                click.echo("no display here: showing the web page instead of a window", err=True)
        return process.serve_web(file)
    except process.RerunError as error:
        raise click.ClickException(str(error)) from error


def _announce(viewer: RerunProcess | None, browser: bool) -> None:
    click.echo(f"view {viewer.url}" if viewer else "view none")
    sys.stdout.flush()
    if browser and viewer and viewer.url.startswith("http:"):
        webbrowser.open(viewer.url)


def _watch(
    endpoint: str,
    event: str | None,
    how: str,
    save: Path | None,
    browser: bool,
    stop: Stop,
) -> None:
    """Show the monitor at ``endpoint`` until stopped, or until the viewer has been closed."""
    os.environ.setdefault("RUST_LOG", "off")  # a viewer that has gone is told in our words, once
    viewer = _viewer(how)
    with contextlib.ExitStack() as ending:
        if viewer is not None:
            ending.callback(viewer.stop)
        session = _session(endpoint)
        ending.callback(session.close)  # with a callback left open the interpreter would not end
        if event:
            _check_event(session, event)
        from monitor.adapters.rerun_view import picture  # noqa: PLC0415

        recording = picture.open_recording(viewer.proxy if viewer else None, save)
        try:
            _draw(session, event, viewer, picture.Picture(recording), browser, stop)
        finally:
            stop.set()
            picture.flush_recording(recording)
            ending.close()  # the viewer first: closing waits for one that is stuck, and the file would suffer
            picture.close_recording(recording)


def _draw(
    session: Any,
    event: str | None,
    viewer: RerunProcess | None,
    picture: Picture,
    browser: bool,
    stop: Stop,
) -> None:
    from .feed import Feed  # noqa: PLC0415

    feed = Feed(session, picture)
    try:
        if event:
            feed.pin(event)
        else:
            feed.listen()
        _announce(viewer, browser)
        while not stop.wait(TICK):
            feed.tick()
            if viewer is not None and not viewer.alive():
                click.echo("the viewer has been closed", err=True)
                break
    finally:
        feed.close()
        feed.tick()  # what had come by the end belongs to the recording


def _check_event(session: Any, event: str) -> None:
    from monitor.adapters import zenoh_bus  # noqa: PLC0415

    if zenoh_bus.ask(session, f"loopsight/**/history/{event}", 10.0):
        return
    raise click.ClickException(f"the monitor knows no event {event}")


def _session(endpoint: str) -> Any:
    """Zenoh session of a client of the monitor's.

    Raises
    ------
    click.ClickException
        No monitor answers there.
    """
    from monitor.adapters import zenoh_bus  # noqa: PLC0415

    options = {"transport/shared_memory/enabled": False}  # a stalled view must not hold the monitor's buffers
    try:
        return zenoh_bus.open_session(mode="client", connect=[endpoint], options=options)
    except zenoh_bus.BusError as error:
        raise click.ClickException(f"no monitor answers: {error}") from error


if __name__ == "__main__":
    main()
