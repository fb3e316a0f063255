"""Command `loopsight tune`: settings by one rule or all, with robustness and predicted responses."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import click

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tuners.models import Model
    from tuners.responses import Response
    from tuners.rules import Rule
    from tuners.settings import Settings

FORMS = ("standard", "series", "parallel")
COLUMNS = {
    "kp": "Kp [OP/PV]",
    "ti": "Ti [s]",
    "td": "Td [s]",
    "tf": "Tf [s]",
    "ms": "Ms",
    "gain_margin": "GM",
    "phase_margin": "PM [deg]",
    "delay_margin": "DM [s]",
    "iae_setpoint": "IAE sp [PV s]",
    "iae_load": "IAE load [PV s]",
    "overshoot": "overshoot",
}
SORTABLE = ("rule", *COLUMNS, "mt", "settling_time")

EPILOG = """\b
Examples:
  loopsight tune --rule simc-pi --gain 0.05 --dead-time 6
  loopsight tune --rule all --gain -0.02 --dead-time 60 --lag 30 --sort ms
  loopsight tune --rule simc-pid --gain 1.2 --dead-time 5 --lag 40
                 --process self-regulating --block logix-pide-independent --json
"""


class WrongUseError(click.ClickException):
    """One line on stderr, exit code 2."""

    exit_code = 2

    def show(self, file: Any = None) -> None:
        """Print the message as one line."""
        click.echo(f"loopsight tune: {' '.join(self.format_message().split())}", file=file, err=file is None)


class OneLineCommand(click.Command):
    """A command whose usage errors are one line too."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Parse, and turn click's three-line complaint into one."""
        try:
            return super().parse_args(ctx, args)
        except click.UsageError as error:
            raise WrongUseError(error.format_message()) from None


def _show_version(ctx: click.Context, _param: click.Parameter, value: bool) -> None:
    if not value or ctx.resilient_parsing:
        return
    from importlib.metadata import PackageNotFoundError, version

    try:
        click.echo(f"loopsight {version('loopsight')}")
    except PackageNotFoundError:
        click.echo("loopsight, not installed")
    ctx.exit()


@click.command(cls=OneLineCommand, epilog=EPILOG)
@click.option("--rule", metavar="NAME|all", help="Tuning rule; see --list.")
@click.option("--gain", type=float, help="Process gain, signed [PV/(OP s)], self-regulating [PV/OP].")
@click.option("--dead-time", type=float, help="Dead time [s].")
@click.option("--lag", type=float, default=0.0, show_default=True, help="Lag [s].")
@click.option("--lag2", type=float, default=0.0, help="Second lag, self-regulating only [s].")
@click.option("--process", default="integrating", show_default=True, help="integrating or self-regulating.")
@click.option("--closed-loop-time", type=float, help="Closed-loop time constant [s]; default: the rule's.")
@click.option("--delta", type=float, help="di-ruscio: largest relative dead-time error.")
@click.option("--c", type=float, help="di-ruscio: method product.")
@click.option("--max-load", type=float, help="averaging: largest load change [OP].")
@click.option("--max-deviation", type=float, help="averaging: allowed excursion [PV].")
@click.option("--form", metavar="FORM", help=f"{', '.join(FORMS)}; default: the rule's own form.")
@click.option("--block", metavar="VENDOR_BLOCK", help="Vendor block, as its faceplate shows it; see --list.")
@click.option("--pv-span", type=float, default=100.0, show_default=True, help="PV range, for blocks in %.")
@click.option("--op-span", type=float, default=100.0, show_default=True, help="OP range, for blocks in %.")
@click.option("--sort", default="iae_load", show_default=True, metavar="COLUMN", help="Column to sort by.")
@click.option("--plot", metavar="FILE", help="Responses to set-point and load step, .png or .svg.")
@click.option("--json", "as_json", is_flag=True, help="JSON instead of a table.")
@click.option("--list", "as_list", is_flag=True, help="Name every rule with its source, and every block.")
@click.option("--version", is_flag=True, is_eager=True, expose_value=False, callback=_show_version)
def tune(as_json: bool, as_list: bool, plot: str | None, **options: Any) -> None:
    """Suggest settings by a tuning rule, with robustness and predicted responses.

    The model has the exact dead time; IAE is that of a unit step of the set point and of a load at the
    process input. A direct-acting loop has a negative gain.
    """
    try:
        if as_list:
            _print_list(as_json)
            return
        rows, skipped, curves = suggest(**options)
        if plot:
            _plot(plot, curves)
    except ValueError as error:
        raise WrongUseError(str(error)) from None
    if as_json:
        import json

        click.echo(json.dumps(rows if options["rule"] == "all" else rows[0], indent=2, allow_nan=False))
        for name, reason in skipped.items():
            click.echo(f"skipped {name}: {reason}", err=True)
    else:
        _print_table(rows, skipped)
        if plot:
            click.echo(f"responses: {plot}")


def suggest(
    *,
    rule: str | None,
    gain: float | None,
    dead_time: float | None,
    lag: float = 0.0,
    lag2: float = 0.0,
    process: str = "integrating",
    form: str | None = None,
    block: str | None = None,
    pv_span: float = 100.0,
    op_span: float = 100.0,
    sort: str = "iae_load",
    **parameters: float | None,
) -> tuple[list[dict[str, Any]], dict[str, str], dict[str, tuple[Response, Response]]]:
    """Rows of the table, the rules that were skipped with the reason, and the responses of each row.

    Parameters
    ----------
    rule
        Name of a rule, or 'all'.
    gain, dead_time, lag, lag2, process
        Process model: [PV/(OP s)] or [PV/OP], times [s].
    form, block
        Form, or id of a vendor block; None: the rule's own form.
    pv_span, op_span
        Ranges for blocks that count in % [PV], [OP].
    sort
        Column to sort by, None last.
    **parameters
        Extra parameters of the rules; None: not given.

    Raises
    ------
    ValueError
        For any wrong input, saying what is accepted.
    """
    from tuners.blocks import find_block
    from tuners.rules import RULES

    model = _model(process, gain, dead_time, lag, lag2)
    if rule != "all" and rule not in RULES:
        raise ValueError(f"rule = {rule!r}: must be all or one of {', '.join(RULES)}")
    if sort not in SORTABLE:
        raise ValueError(f"sort = {sort!r}: must be one of {', '.join(SORTABLE)}")
    if form is not None and form not in FORMS:
        raise ValueError(f"form = {form!r}: must be one of {', '.join(FORMS)}")
    if form is not None and block is not None:
        raise ValueError("form, block: give one of them, a block has its own form")
    given = {name: _finite(name, value) for name, value in parameters.items() if value is not None}
    faceplate = find_block(block) if block is not None else None
    rows, skipped, curves = [], {}, {}
    for name in RULES if rule == "all" else (str(rule),):
        try:
            settings, plate = _settings(RULES[name], model, given, form, faceplate, (pv_span, op_span))
            rows.append(_row(name, RULES[name], model, settings))
            curves[name] = _responses(model, settings)
        except ValueError as reason:
            if rule != "all":
                raise
            skipped[name] = str(reason)
            continue
        rows[-1] |= _predicted(*curves[name]) | _shown(plate)
    rows.sort(key=lambda row: (row[sort] is None, row[sort] if row[sort] is not None else 0))
    return rows, skipped, curves


def _finite(name: str, value: float | None) -> float:
    if value is None or not math.isfinite(value):
        wanted = "must be given" if value is None else "must be a finite number"
        raise ValueError(f"{name.replace('_', '-')} = {value}: {wanted}")
    return value


def _model(process: str, gain: float | None, dead_time: float | None, lag: float, lag2: float) -> Model:
    from tuners.models import IntegratingModel, SelfRegulatingModel

    gain, dead_time = _finite("gain", gain), _finite("dead_time", dead_time)
    lag, lag2 = _finite("lag", lag), _finite("lag2", lag2)
    if process == "self-regulating":
        return SelfRegulatingModel(gain, dead_time, lag, lag2)
    if process != "integrating":
        raise ValueError(f"process = {process!r}: must be integrating or self-regulating")
    if lag2 != 0:
        raise ValueError(f"lag2 = {lag2:g}: is for self-regulating processes, must be 0")
    return IntegratingModel(gain, dead_time, lag)


def _settings(
    rule: Rule,
    model: Model,
    given: dict[str, float],
    form: str | None,
    block: Any,
    spans: tuple[float, float],
) -> tuple[Settings, Any]:
    """Return the settings in the form that was asked for, and the faceplate where a block was."""
    from tuners.blocks import to_block

    if model.process not in rule.processes:
        raise ValueError(
            f"process = {model.process}: this rule is for {' and '.join(rule.processes)} processes"
        )
    missing = [name for name in rule.required if name not in given]
    if missing:
        raise ValueError(f"{', '.join(missing).replace('_', '-')}: must be given for this rule")
    settings = rule.function(model, **{name: given[name] for name in rule.parameters if name in given})
    if block is not None:
        plate = to_block(settings, block, pv_span=spans[0], op_span=spans[1])
        return plate.settings, plate
    return settings.to(form or settings.form), None


def _row(name: str, rule: Rule, model: Model, settings: Settings) -> dict[str, Any]:
    from tuners.robustness import margins

    found = margins(model, settings)
    return {
        "rule": name,
        "form": settings.form,
        "structure": rule.structure,
        **{key: _json(getattr(settings, key)) for key in ("kp", "ti", "td", "tf", "b", "c")},
        **({"ki": _json(settings.ki), "kd": _json(settings.kd)} if settings.form == "parallel" else {}),
        **{
            key: _json(getattr(found, key))
            for key in ("ms", "mt", "gain_margin", "phase_margin", "delay_margin")
        },
        "stable": bool(found.stable),
        "source": rule.source,
    }


def _responses(model: Model, settings: Settings) -> tuple[Response, Response]:
    from tuners.robustness import closed_loop_response

    return closed_loop_response(model, settings, "setpoint"), closed_loop_response(model, settings, "load")


def _predicted(setpoint: Response, load: Response) -> dict[str, Any]:
    return {
        "iae_setpoint": _json(setpoint.iae),
        "iae_load": _json(load.iae),
        "overshoot": _json(setpoint.overshoot),
        "settling_time": _json(setpoint.settling_time),
    }


def _shown(plate: Any) -> dict[str, Any]:
    """Return the fields of the block as its faceplate shows them."""
    if plate is None:
        return {}
    fields = {key: _json(value) if isinstance(value, float) else value for key, value in plate.fields.items()}
    return {
        "block": plate.block.id,
        "block_name": plate.block.name,
        "block_verified": plate.block.verified,
        "fields": fields,
        "units": plate.units,
        "notes": list(plate.notes),
    }


def _json(value: Any) -> float | None:
    """Return a float, or None for what JSON cannot hold."""
    number = float(value)
    return number if math.isfinite(number) else None


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

    console = _console()
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False)
    for title in ("rule", "form", *COLUMNS.values()):
        table.add_column(
            escape(title), justify="left" if title in {"rule", "form"} else "right", no_wrap=True
        )
    for row in rows:
        numbers = (_number(row[key], key) for key in COLUMNS)
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


def _plot(path: str, curves: dict[str, tuple[Response, Response]]) -> None:
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
