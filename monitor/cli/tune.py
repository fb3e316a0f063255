"""Command `loopsight tune`: settings by one rule or all, with robustness and predicted responses."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import click

from .common import Command, Refused

EPILOG = """\b
Examples:
  loopsight tune --rule simc-pi --gain 0.05 --dead-time 6
  loopsight tune --rule all --gain -0.02 --dead-time 60 --lag 30 --sort ms
  loopsight tune --rule simc-pid --gain 1.2 --dead-time 5 --lag 40
                 --process self-regulating --block logix-pide-independent --json
  loopsight tune --rule simc-pi --relay-output 5 --relay-period 60 --relay-amplitude 1.5
"""


@click.command(cls=Command, epilog=EPILOG)
@click.option("--rule", metavar="NAME|all", help="Tuning rule; see --list.")
@click.option("--gain", type=float, help="Process gain, signed [PV/(OP s)], self-regulating [PV/OP].")
@click.option("--dead-time", type=float, help="Dead time [s].")
@click.option("--lag", type=float, default=0.0, show_default=True, help="Lag [s].")
@click.option("--lag2", type=float, default=0.0, help="Second lag, self-regulating only [s].")
@click.option("--process", default="integrating", show_default=True, help="integrating or self-regulating.")
@click.option(
    "--relay-output", type=float, help="Relay test in place of dead time: OP went up and down by it [OP]."
)
@click.option("--relay-period", type=float, help="Relay test: period of the cycle [s].")
@click.option(
    "--relay-amplitude", type=float, help="Relay test: half of PV's peak to peak [PV]; with --gain: lag too."
)
@click.option("--closed-loop-time", type=float, help="Closed-loop time constant [s]; default: the rule's.")
@click.option("--delta", type=float, help="di-ruscio: largest relative dead-time error.")
@click.option("--c", type=float, help="di-ruscio: method product.")
@click.option("--max-load", type=float, help="averaging: largest load change [OP].")
@click.option("--max-deviation", type=float, help="averaging: allowed excursion [PV].")
@click.option("--form", metavar="FORM", help="standard, series or parallel; default: the rule's own form.")
@click.option("--block", metavar="VENDOR_BLOCK", help="Vendor block, as its faceplate shows it; see --list.")
@click.option("--pv-span", type=float, default=100.0, show_default=True, help="PV range, for blocks in %.")
@click.option("--op-span", type=float, default=100.0, show_default=True, help="OP range, for blocks in %.")
@click.option("--sort", default="iae_load", show_default=True, metavar="COLUMN", help="Column to sort by.")
@click.option("--plot", metavar="FILE", help="Responses to set-point and load step, .png or .svg.")
@click.option("--json", "as_json", is_flag=True, help="JSON instead of a table.")
@click.option("--list", "as_list", is_flag=True, help="Name every rule with its source, and every block.")
def tune(as_json: bool, as_list: bool, plot: str | None, **options: Any) -> None:
    """Suggest settings by a tuning rule, with robustness and predicted responses.

    The model has the exact dead time; IAE is that of a unit step of the set point and of a load at the
    process input. A direct-acting loop has a negative gain.
    """
    from tuners.suggest import suggest

    try:
        if as_list:
            _print_list(as_json)
            return
        relayed = options["relay_period"] is not None
        model = _model(options)
        if relayed and not options["rule"]:
            options["rule"] = "all"  # what the test has shown is the question; the rules are the answer
        rows, skipped, curves = suggest(model=model, **options)
        if plot:
            _plot(plot, curves)
    except ValueError as error:
        raise Refused(str(error)) from None
    if as_json:
        import json

        click.echo(json.dumps(rows if options["rule"] == "all" else rows[0], indent=2, allow_nan=False))
        for name, reason in skipped.items():
            click.echo(f"skipped {name}: {reason}", err=True)
    else:
        _print_table(rows, skipped)
        if plot:
            click.echo(f"responses: {plot}")


_RELAY = ("output", "period", "amplitude")


def _model(options: dict[str, Any]) -> Any:
    """Take the options of the process out of all options; the model by a relay test is said on stderr."""
    from tuners.models import INTEGRATING
    from tuners.suggest import model_of, model_of_relay

    relay = {name: options.pop(f"relay_{name}") for name in _RELAY}
    process = {name: options.pop(name) for name in ("process", "gain", "dead_time", "lag", "lag2")}
    if all(value is None for value in relay.values()):
        return model_of(**process)
    if (
        process["dead_time"] is not None
        or process["lag"]
        or process["lag2"]
        or process["process"] != INTEGRATING
    ):
        raise ValueError("relay: shows dead time and lag of an integrating process, give none of them")
    model = model_of_relay(**relay, gain=process["gain"])
    click.echo(
        f"relay test: gain {model.gain:.4g} PV/(OP s), dead time {model.dead_time:.4g} s, lag {model.lag:.4g} s",
        err=True,
    )
    return model


def _number(value: float | str | None, name: str = "") -> str:
    if value is None:
        return "off" if name == "ti" else "-"
    return value if isinstance(value, str) else f"{value:.4g}"


def _console() -> Any:
    from rich.console import Console

    console = Console(highlight=False)
    # A pipe has no width; wrapping a table at 80 columns would make it useless there.
    return console if console.is_terminal else Console(width=200, highlight=False)


def _print_table(rows: Sequence[dict[str, Any]], skipped: dict[str, str]) -> None:
    from rich import box
    from rich.markup import escape
    from rich.table import Table

    from tuners.suggest import SUGGESTED_COLUMNS

    console = _console()
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False)
    for title in ("rule", "form", *SUGGESTED_COLUMNS.values()):
        table.add_column(
            escape(title), justify="left" if title in {"rule", "form"} else "right", no_wrap=True
        )
    for row in rows:
        numbers = (_number(row[key], key) for key in SUGGESTED_COLUMNS)
        name = row["rule"] if row["stable"] else f"{row['rule']} (unstable)"
        table.add_row(name, row["form"], *numbers)
    if rows:
        console.print(table)
    for row in rows:
        if "fields" in row:
            values = (
                f"{key} = {_number(value)} {row['units'].get(key, '')}".strip()
                for key, value in row["fields"].items()
            )
            console.print(
                f"{row['rule']} on {row['block_name']}: {', '.join(values)}", soft_wrap=True, markup=False
            )
            for note in row["notes"]:
                console.print(f"  note: {note}", soft_wrap=True, markup=False)
    for row in rows if len(rows) == 1 else ():
        console.print(f"source: {row['source']}", soft_wrap=True, markup=False)
    for name, reason in skipped.items():
        console.print(f"skipped {name}: {reason}", soft_wrap=True, markup=False)


def _print_list(as_json: bool) -> None:
    from tuners.blocks import BLOCKS
    from tuners.rules import RULES

    rules = [
        {
            "rule": name,
            "structure": rule.structure,
            "form": rule.form,
            "process": list(rule.processes),
            "parameters": list(rule.parameters),
            "source": rule.source,
        }
        for name, rule in RULES.items()
    ]
    if as_json:
        import json

        click.echo(json.dumps(rules, indent=2, ensure_ascii=False))
        return
    for entry in rules:
        extra = "".join(f" --{name.replace('_', '-')}" for name in entry["parameters"])
        kinds = ", ".join(entry["process"])
        click.echo(
            f"{entry['rule']}: {entry['structure']}, {entry['form']} form, {kinds}{extra}; {entry['source']}"
        )
    click.echo("")
    for block in BLOCKS.values():
        mark = "" if block.verified else " (not verified)"
        click.echo(f"block {block.id}: {block.name}, {' or '.join(block.forms)}{mark}; {block.source}")


def _plot(path: str, curves: dict[str, Any]) -> None:
    """Write the responses to set-point and load step to a file."""
    if not path.lower().endswith((".png", ".svg")):
        raise ValueError(f"plot = {path}: must end in .png or .svg")
    try:
        from matplotlib.figure import Figure
    except ImportError:
        raise ValueError("plot: needs matplotlib, install loopsight[plot]") from None
    import numpy as np

    figure = Figure(figsize=(11, 6.5), layout="constrained")
    grid = figure.subplots(2, 2, sharex="col", height_ratios=(2, 1))
    for column, title in enumerate(("set-point step", "load step")):
        shown = {name: pair[column] for name, pair in curves.items() if pair[column].time.size}
        above, below = grid[0][column], grid[1][column]
        above.axhline(1.0 if column == 0 else 0.0, color="0.5", linewidth=0.8, label="SP")
        for name, response in shown.items():
            (line,) = above.plot(response.time, response.pv, label=name, linewidth=1.2)
            below.plot(response.time, response.op, color=line.get_color(), linewidth=1.0)
        if shown:
            # One sluggish rule among many must not squeeze the others into the left edge.
            ends = [min(r.time[-1], 2 * r.settling_time) for r in shown.values()]
            below.set_xlim(0, min(max(ends), 2 * float(np.median(ends))))
        above.set(title=f"unit {title}", ylabel="SP, PV [PV]")
        below.set(xlabel="time [s]", ylabel="OP [OP]")
        above.grid(alpha=0.3)
        below.grid(alpha=0.3)
    grid[0][1].legend(fontsize="x-small", ncols=1 + len(curves) // 12)
    try:
        figure.savefig(path)
    except OSError as error:
        raise ValueError(f"plot = {path}: cannot be written ({error.strerror})") from None
