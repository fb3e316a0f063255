"""``loopsight status``: asks monitors over Zenoh, prints what an operator wants to know."""

from __future__ import annotations

from typing import Any

import click

from monitor.contract.status import NOT_READY
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
        answers = ask_monitors(connect, zenoh)
    except OSError as error:
        raise Refused(str(error)) from None
    if not answers:
        raise Refused(f"{connect}: no monitor answers")
    show(answers, as_json)


def ask_monitors(endpoint: str, zenoh: str = "") -> list[dict[str, Any]]:
    """Return the health of every monitor that answers at an endpoint.

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
    return [msgspec.json.decode(payload, type=dict[str, Any]) for _, payload in replies]


def show(answers: list[dict[str, Any]], as_json: bool) -> None:
    """Print the answers: JSON, one object a line, or lines for a reader."""
    import msgspec

    for answer in answers:
        click.echo(msgspec.json.encode(answer).decode() if as_json else "\n".join(_lines(answer)))


def _lines(answer: dict[str, Any]) -> list[str]:
    from monitor.contract.records import WORST_FIRST

    loops = answer["loops"]
    refused = ", ".join(f"{answer[n]} {n.replace('_', ' ')}" for n in REFUSED if answer.get(n))
    rates = answer["rates"]
    verdicts = ", ".join(f"{loops[v]} {v.replace('_', ' ')}" for v in WORST_FIRST)
    lines = [
        f"monitor {answer['id']}: {_ready(answer)}, up {answer['uptime']:.0f} s",
        f"  loops     {loops['total']}: {verdicts}; {loops['open']} events open, {loops['stale']} stale",
        f"  samples   {answer['samples_ok']} good, {rates['samples']}/s in {rates['messages']} messages/s",
        f"  refused   {refused or 'nothing'}",
        f"  waiting   {answer['queue']} messages, {answer['held']} samples held for order, {answer['backlog']} events",
        f"  behind    {answer.get('latency', 0.0):.1f} s",
        f"  flagged   {', '.join(answer['flagged']) or 'none'}",
    ]
    further = {
        "stale": answer.get("stale"),
        "unheard": answer.get("never_heard"),
        "clocks": _clocks(answer),
        "unknown": answer.get("unknown"),
    }
    for what, names in further.items():
        if names:
            lines.append(f"  {what:<9} {', '.join(map(visible, names))}")
    return lines


def _ready(answer: dict[str, Any]) -> str:
    if answer["ready"]:
        return "ready"
    return f"NOT READY ({', '.join(NOT_READY.get(w, visible(w)) for w in answer['not_ready'])})"


def _clocks(answer: dict[str, Any]) -> list[str]:
    steps = answer.get("clock_steps")
    return [*([f"{steps} set back"] if steps else []), *(f"{n} ahead" for n in answer.get("clock_ahead", []))]
