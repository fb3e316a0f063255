"""``loopsight status``: asks monitors over Zenoh, prints what an operator wants to know."""

from __future__ import annotations

from typing import Any

import click

from monitor.contract.status import NOT_READY, Status
from monitor.contract.text import visible

from .common import Command, Refused, zenoh_option

ANSWER_WITHIN_S = 3.0
"""How long monitors may take to answer [s]."""
REFUSED = (
    "bad_value", "bad_quality", "duplicate", "late", "future", "bad_time", "malformed", "too_large",
    "unknown_loop", "missed_frames", "repeated_frames", "dropped", "reorder_overflow", "records_lost",
    "publish_failed",
)  # fmt: skip


@click.command(cls=Command, epilog="Example: loopsight status --json")
@click.option("--connect", default="tcp/127.0.0.1:7447", show_default=True, metavar="ENDPOINT")
@zenoh_option
@click.option("--json", "as_json", is_flag=True, help="One JSON object for each monitor.")
def status(connect: str, zenoh: str, as_json: bool) -> None:
    """Ask running monitors: alive, loops, rates, what was refused and why, flagged loops.

    Exit 0 when at least one answers, 2 when none does.
    """
    try:
        answers, wrong = ask_monitors(connect, zenoh)
    except OSError as error:
        raise Refused(str(error)) from None
    for line in wrong:
        click.echo(f"loopsight status: {visible(line, 500)}", err=True)
    if not answers:
        raise Refused(f"{connect}: no monitor answers")
    show(answers, as_json)


def ask_monitors(endpoint: str, zenoh: str = "") -> tuple[list[dict[str, Any]], list[str]]:
    """Return the health of every monitor that answers at an endpoint, and what is wrong with other answers.

    Whoever may write to the bus may answer: what is no status, or another's, is named and left out.

    Parameters
    ----------
    zenoh
        Zenoh's own configuration (.json5); empty: none.

    Raises
    ------
    BusError
        Nothing listens there.
    """
    import msgspec

    from monitor.adapters.zenoh_bus import ask, open_session
    from monitor.contract import keys

    session = open_session("client", connect=[endpoint], file=zenoh)
    try:
        replies = ask(session, keys.monitor_status("*"), ANSWER_WITHIN_S)
    finally:
        session.close()
    answers, wrong = [], []
    for key, payload in replies:
        try:
            answer = msgspec.json.decode(payload, type=dict[str, Any])
            name = msgspec.convert(answer, Status).id
        except (ValueError, RecursionError, msgspec.MsgspecError) as error:
            wrong.append(f"{key}: an answer that is no status of a monitor: {error}")
            continue
        if key == keys.monitor_status(name):
            answers.append(answer)
        else:
            wrong.append(f"{key}: an answer of another monitor: {name}")
    return answers, wrong


def show(answers: list[dict[str, Any]], as_json: bool) -> None:
    """Print the answers: JSON, one object a line, or lines for a reader."""
    import json

    import msgspec

    for answer in answers:
        for line in [json.dumps(answer)] if as_json else _lines(msgspec.convert(answer, Status)):
            click.echo(visible(line))


def _lines(answer: Status) -> list[str]:
    from monitor.contract.records import WORST_FIRST

    loops = answer.loops
    refused = ", ".join(f"{getattr(answer, n)} {n.replace('_', ' ')}" for n in REFUSED if getattr(answer, n))
    verdicts = ", ".join(f"{getattr(loops, v)} {v.replace('_', ' ')}" for v in WORST_FIRST)
    lines = [
        f"monitor {answer.id}: {_ready(answer)}, up {answer.uptime:.0f} s",
        f"  loops     {loops.total}: {verdicts}; {loops.open} events open, {loops.stale} stale",
        f"  samples   {answer.samples_ok} good, {answer.rates.samples}/s in {answer.rates.messages} messages/s",
        f"  refused   {refused or 'nothing'}",
        f"  waiting   {answer.queue} messages, {answer.held} samples held for order, {answer.backlog} events",
        f"  behind    {answer.latency:.1f} s",
        f"  flagged   {', '.join(answer.flagged) or 'none'}",
    ]
    further = {
        "stale": answer.stale,
        "unheard": answer.never_heard,
        "shelved": [f"{name} {until}" for name, until in answer.shelved.items()],
        "clocks": _clocks(answer),
        "unknown": answer.unknown,
        "twins": [f"others under this id: {answer.twins}"] if answer.twins else [],
    }
    return [*lines, *(f"  {what:<9} {', '.join(names)}" for what, names in further.items() if names)]


def _ready(answer: Status) -> str:
    if answer.ready:
        return "ready"
    return f"NOT READY ({', '.join(NOT_READY.get(why, why) for why in answer.not_ready)})"


def _clocks(answer: Status) -> list[str]:
    steps = answer.clock_steps
    return [*([f"{steps} set back"] if steps else []), *(f"{n} ahead" for n in answer.clock_ahead)]
