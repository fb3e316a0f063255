"""What all commands share: one style of error, the version."""

from __future__ import annotations

from collections.abc import Callable

import click


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


def parent_option(command: Callable[..., None]) -> Callable[..., None]:
    """Add ``--parent``, by which a command of ours that another one has started ends with it."""
    return click.option(
        "--parent", type=int, hidden=True, help="End when the process with this id is no longer our parent."
    )(command)
