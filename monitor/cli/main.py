"""The command `loopsight`: options, one line for each error, exit codes. What a command does stands in its driver.

Heavy libraries are imported inside the commands, so that `--help` answers at once.
"""

from __future__ import annotations

import importlib
import os
import sys
from collections.abc import Sequence

import click

from .common import Command

COMMANDS = {
    "demo": ("monitor.cli.demo:demo", "A simulated plant, the monitor and a Rerun view in one go."),
    "monitor": ("monitor.cli.monitor:monitor", "The long-running service."),
    "import": (
        "monitor.cli.importing:import_exports",
        "Read any export: how it is understood, and a loop table.",
    ),
    "audit": ("monitor.cli.audit:audit", "Fleet audit of historian exports."),
    "compare": ("monitor.cli.compare:compare", "Two audits of the same loops, before and after."),
    "report": ("monitor.cli.report:report", "An audit's report.html, drawn again."),
    "tune": ("monitor.cli.tune:tune", "Settings by any tuning rule, with their robustness."),
    "view": ("monitor.cli.view:view", "Live or recorded visual inspection in Rerun."),
    "status": ("monitor.cli.status:status", "Ask running monitors how they are."),
    "check": ("monitor.cli.check:check", "Validate configuration, loop tables and data."),
    "simulate": (
        "monitor.cli.simulate:simulate",
        "Publish simulated loops, or write them as an export with the truth.",
    ),
}


class Commands(Command, click.Group):
    """Commands that are imported when they are called."""

    def list_commands(self, _ctx: click.Context) -> list[str]:
        """Return the names, in the order in which a newcomer meets them."""
        return list(COMMANDS)

    def get_command(self, _ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Import a command."""
        if cmd_name not in COMMANDS:
            return None
        module, _, name = COMMANDS[cmd_name][0].partition(":")
        command: click.Command = getattr(importlib.import_module(module), name)
        return command

    def format_commands(self, _ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """List the commands without importing them."""
        with formatter.section("Commands"):
            formatter.write_dl([(name, text) for name, (_, text) in COMMANDS.items()])


@click.group(
    cls=Commands,
    epilog="Example: loopsight demo",
    context_settings={"help_option_names": ["-h", "--help"]},
)
def loopsight() -> None:
    """Control-loop performance monitor: finds badly tuned PID loops, says why, and suggests safe settings.

    Advice only: it never writes to a controller.
    """


def run(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit code: every error is one line on stderr, never a traceback.

    Parameters
    ----------
    arguments
        Without the program's name; None: those that the process was started with.
    """
    try:
        code = loopsight.main(arguments, standalone_mode=False, prog_name="loopsight")
    except click.ClickException as error:
        error.show()
        return error.exit_code
    except (click.Abort, KeyboardInterrupt):
        return 130
    except BrokenPipeError:  # `loopsight ... | head`
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # what is left goes nowhere
        return 0
    except Exception as error:  # the last line of defence
        if os.environ.get("LOOPSIGHT_DEBUG"):
            raise
        what = f"internal error: {type(error).__name__}: {error} (LOOPSIGHT_DEBUG=1 shows where)"
        click.echo(f"loopsight: {what}", err=True)
        return 1
    return code if isinstance(code, int) else 0


def main() -> None:
    """Run the command line, and end with its exit code."""
    sys.exit(run())
