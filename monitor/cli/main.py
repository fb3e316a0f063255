"""The command `loopsight`: options, one line for each error, exit codes. What a command does stands in its driver.

Heavy libraries are imported inside the commands, so that `--help` answers at once.
"""

from __future__ import annotations

import importlib
import os
import sys

import click

from .common import version_option

COMMANDS = {
    "demo": ("monitor.cli.demo:demo", "A simulated plant, the monitor and a Rerun view in one go."),
    "monitor": ("monitor.cli.monitor:monitor", "The long-running service."),
    "audit": ("monitor.cli.audit:audit", "Fleet audit of historian exports."),
    "tune": ("monitor.cli.tune:tune", "Settings by any tuning rule, with their robustness."),
    "view": ("monitor.view.process:view_command", "Live or recorded visual inspection in Rerun."),
    "status": ("monitor.cli.status:status", "Ask running monitors how they are."),
    "check": ("monitor.cli.check:check", "Validate configuration, loop tables and data."),
    "simulate": (
        "monitor.cli.simulate:simulate",
        "Publish simulated loops, or write them as an export with the truth.",
    ),
}


class Commands(click.Group):
    """Commands that are imported when they are called."""

    def list_commands(self, ctx: click.Context) -> list[str]:  # noqa: ARG002
        """Return the names, in the order in which a newcomer meets them."""
        return list(COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:  # noqa: ARG002
        """Import a command."""
        if cmd_name not in COMMANDS:
            return None
        module, _, name = COMMANDS[cmd_name][0].partition(":")
        command = getattr(importlib.import_module(module), name)
        assert isinstance(command, click.Command)  # noqa: S101
        if not any(parameter.name == "version" for parameter in command.params):
            command.params.append(version_option())
        return command

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:  # noqa: ARG002
        """List the commands without importing them."""
        with formatter.section("Commands"):
            formatter.write_dl([(name, text) for name, (_, text) in COMMANDS.items()])


@click.group(
    cls=Commands,
    params=[version_option()],
    epilog="Example: loopsight demo",
    context_settings={"help_option_names": ["-h", "--help"]},
)
def loopsight() -> None:
    """Control-loop performance monitor: finds badly tuned PID loops, says why, and suggests safe settings.

    Advice only: it never writes to a controller.
    """


def main() -> None:
    """Run the command line: every error is one line on stderr, never a traceback."""
    try:
        code = loopsight.main(standalone_mode=False, prog_name="loopsight")
    except click.ClickException as error:
        for line in error.format_message().splitlines():
            click.echo(f"loopsight: {line}", err=True)
        code = error.exit_code
    except (click.Abort, KeyboardInterrupt):
        code = 130
    except BrokenPipeError:  # `loopsight ... | head`
        sys.stdout = open(os.devnull, "w")  # noqa: PTH123, SIM115
        code = 0
    except Exception as error:  # the last line of defence
        if os.environ.get("LOOPSIGHT_DEBUG"):
            raise
        click.echo(
            f"loopsight: internal error: {type(error).__name__}: {error} (LOOPSIGHT_DEBUG=1 shows where)",
            err=True,
        )
        code = 1
    sys.exit(code if isinstance(code, int) else 0)
