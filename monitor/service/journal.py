"""What the monitor says of itself: every message with a code that stays, in lines for a reader or for a machine.

Whoever watches the log looks for the code; `docs/operation.md` says what each means and what to do. However many loops
have the same trouble, it is at most a line a minute; what was left out is counted in the next one.
"""

from __future__ import annotations

import logging
import sys
import time
from collections.abc import Callable
from logging import DEBUG, ERROR, INFO, WARNING
from typing import Any

import msgspec

from monitor.contract.text import visible
from monitor.contract.times import iso

log = logging.getLogger("loopsight")

FORMATS = ("text", "json")
AGAIN_AFTER_S = 60.0
"""Between two lines of the same warning or error [s]."""
WITHOUT_CODE = "other"
"""Code of what a library says."""

MESSAGES: dict[str, tuple[int, str]] = {
    "assessment": (DEBUG, "{loop}: {verdict} ({kind}) {reason}"),
    "retune": (INFO, "{loop}: {verdict} ({kind}) {reason}"),
    "suggestion": (INFO, "{loop}: suggestion: {action}"),
    "network_open": (
        WARNING,
        "{address} is open to the network: use TLS and access control, see config/zenoh",
    ),
    "http_open": (WARNING, "{address} is open to the network, without a password"),
    "router_absent": (WARNING, "{why}; tried again every second, not ready meanwhile"),
    "same_id": (
        WARNING,
        "others call themselves {monitor}, too ({count}): give each monitor an id of its own",
    ),
    "registration_full": (
        WARNING,
        "{count} loops have registered themselves, no more are taken: put them into a loop table",
    ),
    "store_failing": (ERROR, "store: {why}; nothing is published until it is back"),
    "store_back": (WARNING, "store: back; {count} records were waiting"),
    "store_untidy": (DEBUG, "store: {why}; nothing old is removed"),
    "records_lost": (ERROR, "store: still failing; {count} records are lost"),
    "refused_malformed": (WARNING, "malformed: {key}: {why}"),
    "refused_too_large": (WARNING, "too_large: {key}: {why}"),
    "refused_future": (WARNING, "future: {key}: {why}"),
    "refused_bad_time": (WARNING, "bad_time: {key}: {why}"),
    "clock_set_back": (WARNING, "{loop}: its clock was set back to {first}; it begins anew"),
    "all_silent": (WARNING, "no good samples of any loop: not ready"),
    "samples_back": (WARNING, "samples are back"),
    "loops_stale": (WARNING, "stale: {loops}"),
    "loops_never_heard": (WARNING, "nothing has come of {count} loops of the table: {loops}"),
    "loops_unmatched": (
        WARNING,
        "no subscription hears the keys of {count} loops, frames alone can bring them: {loops}",
    ),
    "loops_bad": (WARNING, "only bad samples: {loops}"),
    "loops_back": (WARNING, "heard again: {loops}"),
    "loop_given_up": (WARNING, "given up after a long silence: {loop}"),
    "store_damaged": (ERROR, "store: {why}"),
    "taken_up": (
        INFO,
        "what is known of {count} loops is taken up again; {waiting} events wait to be assessed",
    ),
    "memory_version": (
        WARNING,
        "of {count} loops the settings hold; what else was known is another version's, and begins anew",
    ),
    "memory_damaged": (WARNING, "store: {key}: {why}; it begins anew"),
    "shelved": (INFO, "{loop}: its flag is put aside until {until}: {why}"),
    "unshelved": (INFO, "{loop}: its flag is put back"),
    "reloaded": (
        INFO,
        "configuration read again: {added} loops new, {changed} changed, {removed} gone; {loops} now",
    ),
    "reload_refused": (ERROR, "configuration not taken over, the old one holds: {why}"),
    "reload_later": (WARNING, "{names}: changed, in force after a restart"),
    "events_interrupted": (WARNING, "{count} events were open when the last run ended: interrupted"),
    "events_taken_up": (WARNING, "{count} open events are taken up again after {seconds:.0f} s"),
    "snapshot_version": (
        WARNING,
        "open events of the last run are another version's; they are not taken up again",
    ),
    "snapshot_damaged": (WARNING, "{path}: {why}; open events of the last run are not taken up again"),
    "snapshot_failing": (DEBUG, "{path}: {why}"),
    "stopped_early": (
        WARNING,
        "stop: {count} events are left to be assessed at the next start, {messages} messages are lost",
    ),
}
"""Level and text of each message by its code; its fields are those of the JSON, too."""


def note(code: str, **fields: object) -> None:
    """Say one of the `MESSAGES`; what does not print in its fields is made visible."""
    level, text = MESSAGES[code]
    if log.isEnabledFor(level):
        log.log(level, "%s", visible(text.format(**fields)), extra={"code": code, "fields": fields})


def begin(form: str, verbose: bool = False) -> None:
    """Write all that is said to stderr from now on.

    Parameters
    ----------
    form
        One of `FORMATS`.
    verbose
        Say every assessment.
    """
    handler = logging.StreamHandler(sys.stderr)
    handler.addFilter(OnceAMinute())
    handler.setFormatter(JsonLines() if form == "json" else Lines())
    logging.basicConfig(handlers=[handler], level=INFO)
    log.setLevel(DEBUG if verbose else INFO)


class OnceAMinute(logging.Filter):
    """Lets a warning or an error with the same code through once in `AGAIN_AFTER_S`, with how many it left out."""

    def __init__(self, monotonic: Callable[[], float] = time.monotonic) -> None:
        super().__init__()
        self._monotonic = monotonic
        self._said: dict[str, tuple[float, int]] = {}
        """When a code was let through last, and how often it was not since then."""

    def filter(self, record: logging.LogRecord) -> bool:
        """Whether to say it; results are no trouble, and always said."""
        if record.levelno < WARNING:
            return True
        code, now = getattr(record, "code", record.name), self._monotonic()
        since, left_out = self._said.get(code, (-AGAIN_AFTER_S, 0))
        if now - since < AGAIN_AFTER_S:
            self._said[code] = (since, left_out + 1)
            return False
        self._said[code] = (now, 0)
        record.left_out = left_out
        return True


class Lines(logging.Formatter):
    """``time LEVEL code: message``, for a reader."""

    def format(self, record: logging.LogRecord) -> str:
        """Return the line."""
        facts = _facts(record)
        left_out = f" ({facts['left_out']} more since the last such line)" if "left_out" in facts else ""
        return f"{facts['time']} {record.levelname} {facts['code']}: {facts['message']}{left_out}"


class JsonLines(logging.Formatter):
    """One JSON object a line: ``time, level, code, message``, how many were ``left_out``, and the message's fields."""

    def format(self, record: logging.LogRecord) -> str:
        """Return the line."""
        fields = {n: _plain(v) for n, v in getattr(record, "fields", {}).items()}
        return msgspec.json.encode({**_facts(record), **fields}).decode()


def _facts(record: logging.LogRecord) -> dict[str, Any]:
    """Return what every line has; what a library says is made visible, too."""
    message = record.getMessage()
    if record.exc_info and record.exc_info[1] is not None:
        message += f": {record.exc_info[1]!r}"
    facts = {
        "time": iso(round(record.created * 1e9)),
        "level": record.levelname.lower(),
        "code": getattr(record, "code", WITHOUT_CODE),
        "message": visible(message),
    }
    left_out = getattr(record, "left_out", 0)
    return {**facts, "left_out": left_out} if left_out else facts


def _plain(value: object) -> Any:
    return value if isinstance(value, bool | int | float) else visible(value)
