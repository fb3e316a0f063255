"""What all commands share: one style of error, the version, following who started them."""

from __future__ import annotations

from collections.abc import Callable
from typing import IO, Any, TypeVar

import click
from click.exceptions import NoArgsIsHelpError

from monitor.contract.text import visible

T = TypeVar("T")


class Refused(click.ClickException):
    """Wrong use: a line for each problem, ``loopsight COMMAND: ...`` on stderr; exit 2."""

    exit_code = 2

    def __init__(self, message: str) -> None:
        super().__init__(message)
        context = click.get_current_context(silent=True)
        in_command = context is not None and not isinstance(context.command, click.Group)
        self._who = f"loopsight {context.command.name}" if context and in_command else "loopsight"

    def show(self, file: IO[Any] | None = None) -> None:
        """Print the lines."""
        for line in self.format_message().splitlines():
            click.echo(f"{self._who}: {visible(line)}", file=file, err=file is None)


class Failed(Refused):
    """What was asked for is right, and could not be done; exit 1."""

    exit_code = 1


class Command(click.Command):
    """A command with ``--version``, whose usage errors are one line, as all others are."""

    def __init__(self, *arguments: Any, **facts: Any) -> None:
        super().__init__(*arguments, **facts)
        self.params.append(
            click.Option(
                ["--version"],
                is_flag=True,
                is_eager=True,
                expose_value=False,
                callback=_version,
                help="Show the version.",
            )
        )

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Parse; refuse in one line what is wrong."""
        return _in_one_line(super().parse_args, ctx, args)

    def invoke(self, ctx: click.Context) -> Any:
        """Run; refuse in one line what is wrong."""
        return _in_one_line(super().invoke, ctx)


def parent_option(command: Callable[..., None]) -> Callable[..., None]:
    """Add ``--parent``, by which a command of ours that another one has started ends with it."""
    return click.option(
        "--parent", type=int, hidden=True, help="End when the process with this id is no longer our parent."
    )(command)


def zenoh_option(command: Callable[..., None]) -> Callable[..., None]:
    """Add ``--zenoh``, by which a command reaches a bus that asks who it is."""
    return click.option(
        "--zenoh",
        default="",
        metavar="FILE",
        help="Zenoh's own configuration (.json5): TLS, certificates, passwords; see config/zenoh.",
    )(command)


def since_audit_option(command: Callable[..., None]) -> Callable[..., None]:
    """Add ``--since-audit``, by which page one of a report says what has changed since an earlier audit."""
    return click.option(
        "--since-audit",
        metavar="DIR",
        help="Folder of the last audit of these loops: page one of the report says what has changed since.",
    )(command)


def _in_one_line(function: Callable[..., T], *arguments: Any) -> T:
    try:
        return function(*arguments)
    except NoArgsIsHelpError:
        raise
    except click.UsageError as error:
        raise Refused(" ".join(error.format_message().split())) from None


def _version(ctx: click.Context, _param: click.Parameter, value: bool) -> None:
    if value:
        from importlib.metadata import PackageNotFoundError, version

        try:
            click.echo(f"loopsight {version('loopsight')}")
        except PackageNotFoundError:  # a checkout that was never installed
            click.echo("loopsight, not installed")
        ctx.exit()
