"""The check as a command."""

from __future__ import annotations

from click.testing import CliRunner, Result

from monitor.cli.check import check as check_command

GOOD = "loop,time,sp,pv,op\n" + "".join(f"LIC-1,{10 * k},50,{50 + k % 3},40\n" for k in range(20))


def check(*args: object) -> Result:
    return CliRunner().invoke(check_command, [str(a) for a in args])
