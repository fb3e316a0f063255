"""The settings that a loop runs under: as its table has them, as the data show them, and since when."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import msgspec
import numpy as np

from monitor.contract.loops import Loop
from monitor.contract.times import in_words
from monitor.detect.event import EventWindow
from monitor.identify.controller import see_controller
from monitor.identify.controller_seen import (
    AS_DECLARED,
    BESIDE,
    CONTRADICTED,
    NOT_LINEAR,
    UNRESOLVED,
    Controller,
    combined,
    differ,
)
from tuners.settings import Settings

TABLE, DATA = "table", "data"
"""Where the settings in force are known from."""
MOST_WINDOWS = 8
"""Windows that are kept of what the data show of a controller."""
SHOWS_DELAY_SHARE = 0.99
"""Share of OP's movement that must be explained for a window to show that there is no filter and no delay."""
LEAST_POINTS = 30
"""Points without which a window shows no controller."""
TAKEN_BACK_EVENTS = 3
"""Events in a row as declared that take back a law of another kind: a small one shows nothing of a gap."""
JOINED_STRETCHES, MOST_STRETCHES = 4, 8
"""Stretches in a row from which, and up to which, they are looked at together where the table names no settings, or
none of them shows the table's."""
SOON_PERIODS = 1024.0
"""Sample periods after samples that show the table's settings within which quiet ones are not looked at again."""
SHARP_WIDTH = 1.0
"""Widths of gain and integral time together, as shares, below which a window that does not contradict a table confirms
it."""
UNKNOWN_WIDTH = 100.0
"""Of an interval without an end, as a share of its value."""
TOLD_SHARE = 0.01
"""Relative difference of a setting from which it is told."""


@dataclass(frozen=True, slots=True)
class Change:
    """Settings that have changed without anybody saying so."""

    after: int
    """End of the last samples that show the old ones [ns since 1970]."""
    before: int
    """Begin of the first samples that show the new ones [ns since 1970]."""
    old: Settings
    new: Settings


@dataclass(slots=True)
class InForce:
    """What is known of a loop's controller.

    The loop table is believed until the data contradict it. Where they did so from the beginning, the table is wrong;
    where its settings were seen before, somebody has changed them since, and those seen now are the loop's.
    """

    table: Loop
    """The loop's row of its table."""
    seen: Controller | None = None
    """The controller of today as the data show it, the last windows together."""
    guess: Controller | None = None
    """The best of what windows show that do not resolve the controller: for the eye, nothing rests on it."""
    contradiction: str = ""
    """In what the data contradict the table, or any linear controller, in words; empty where they do not."""
    since: int | None = None
    """When these settings came into force [ns since 1970]; None: they were there from the start."""
    extra_delay: float = 0.0
    """Dead time that the controller adds to the process [s]: the most that was seen, until a window shows less."""
    change: Change | None = None
    """The last change that was seen."""
    _loop: Loop | None = None
    """The row with settings of the data, where those are in force."""
    _confirmed: bool = False
    """The table's settings have been seen."""
    _windows: list[Controller] = field(default_factory=list)
    """What the last windows under the settings of today show."""
    _by_event: bool = False
    """An event's window is among them; before, only quiet stretches."""
    _until: int = 0
    """End of the last samples that show the settings of today [ns since 1970]."""
    _pieces: list[tuple[EventWindow, int, int]] = field(default_factory=list)
    """Stretches in a row, with their starts and ends [ns since 1970], that are looked at together."""
    _law: str = ""
    """In what the law is another one, in words: a gain that varies with the error, other set-point weights. Quiet
    stretches show nothing of it, and do not take it back."""
    _by_setpoint: bool = False
    """It is the set point's weights: taken back by a window in which the set point moves as the table has it."""
    _as_declared: int = 0
    """Events in a row that show the loop as declared, since one showed another law."""
    _doubt: tuple[Controller, int] | None = None
    """What the last window showed, and its start [ns since 1970], where it was a quiet stretch that says otherwise."""

    @property
    def loop(self) -> Loop:
        """The loop's row, with the settings in force."""
        return self.table if self._loop is None else self._loop

    @property
    def source(self) -> str:
        """`TABLE`, `DATA`, or empty where the settings are not known."""
        if self._loop is not None:
            return DATA
        return "" if self.table.kp is None else TABLE

    def seen_since(self, time: int) -> bool:
        """Whether samples from after a time [ns since 1970] have shown the settings of today."""
        return self._until > time

    def look(self, window: EventWindow, start: int, end: int, period: float) -> bool:
        """Look at the controller in some samples; return whether it has other settings than before.

        Parameters
        ----------
        start, end
            Of the window [ns since 1970].
        period
            Of the samples [s].
        """
        if self.since is not None and start < self.since:
            window, start = _from(window, start, self.since)  # what lies before shows other settings
        declared = (self.table.pv_filter or 0.0) + 0.5 * max((self.table.scan or 0.0) - period, 0.0)
        self.extra_delay = max(self.extra_delay, declared)
        event = window.before < len(window)
        soon = self._confirmed and start - self._until < SOON_PERIODS * period * 1e9
        if len(window) < LEAST_POINTS or (soon and not event):
            return False
        joined = None if event else self._joined(window, start, end, period)
        found = None if joined is None else self._see(joined[0], period)
        whole = found is not None
        if joined is not None and whole:
            window, start = joined
        else:
            found = self._see(window, period)
        if found is None:
            return False
        first = self._first_seen(found, event, start)
        if first is None or self._is_other_law(found, event, bool(np.ptp(window.sp) > 0)):
            return False
        if self._loop is not None and self.seen is not None:
            if whole and self._confirms(found) and _width(found) <= _width(self.seen):
                self._windows, self.seen = [], None  # all of the stretches together show more than each
            elif event and not self._by_event and differ(self.seen, found):
                self._windows, self.seen = [], None  # what quiet stretches showed was a first guess
        if event or whole or not self._by_event or not self._confirms(found):
            by_data = self._loop is not None
            changed = self._by_data(found, window, first, period) if by_data else self._by_table(found, first)
            self._by_event = event or (self._by_event and not changed)
        else:  # a stretch confirms what an event has shown better
            changed, self.contradiction = False, self._law
        self._until = max(end, self._until)
        return changed

    def _first_seen(self, found: Controller, event: bool, start: int) -> int | None:
        """Return since when what a window from ``start`` on shows has been seen [ns since 1970].

        None: it is a quiet stretch that says something new, which another one has to confirm.
        """
        doubt = self._doubt
        self._doubt = None
        if self._confirms(found):
            return start
        same = doubt is not None and doubt[0].said == found.said and not differ(doubt[0], found)
        if not event and not same:
            self._doubt = found, start
            return None
        return doubt[1] if doubt is not None and same else start

    def _is_other_law(self, found: Controller, event: bool, stepped: bool) -> bool:
        """Note a law that is none of the table's, whatever its settings; return whether it is one.

        Events that show the loop as declared take it back; of a law at the set point, one in which it has ``stepped``.
        """
        if found.said == NOT_LINEAR or found.setpoint_only:
            self._law = self.contradiction = found.cause
            self._by_setpoint, self._as_declared = found.setpoint_only, 0
            return True
        if event and found.said in {AS_DECLARED, BESIDE}:
            self._as_declared += 1
            if stepped if self._by_setpoint else self._as_declared >= TAKEN_BACK_EVENTS:
                self._law, self._by_setpoint = "", False
        return False

    def _see(self, window: EventWindow, period: float) -> Controller | None:
        """Return what a window shows of the controller; None where that is not resolved."""
        found = see_controller(window, period, self.table if self._loop is None else _bare(self.table))
        if found is not None and found.said == CONTRADICTED and self._confirmed and not found.setpoint_only:
            # other settings have to be seen by themselves
            found = see_controller(window, period, _bare(self.table))
        if found is None or found.said != UNRESOLVED:
            return found
        if self.guess is None or _width(found) <= _width(self.guess):
            self.guess = found
        return None

    def _joined(
        self, window: EventWindow, start: int, end: int, period: float
    ) -> tuple[EventWindow, int] | None:
        """Return the stretches in a row as one, with its start [ns], once there are enough; None before."""
        if self.seen is not None and self.table.kp is not None:
            self._pieces = []
            return None
        follows = bool(self._pieces) and start - self._pieces[-1][2] < 1.5 * period * 1e9
        self._pieces = [*(self._pieces if follows else []), (window, start, end)]
        if len(self._pieces) < JOINED_STRETCHES:
            return None
        pieces = self._pieces
        if len(pieces) == MOST_STRETCHES:
            self._pieces = []
        first = pieces[0][1]
        time = np.concatenate([w.time + (at - first) * 1e-9 for w, at, _ in pieces])
        sp, pv, op = (np.concatenate([getattr(w, n) for w, _, _ in pieces]) for n in ("sp", "pv", "op"))
        return EventWindow(time, sp, pv, op, len(time)), first

    def _confirms(self, found: Controller) -> bool:
        """Whether a window shows what is known already."""
        if self._loop is None and self.table.kp is not None:
            return found.said in {AS_DECLARED, BESIDE}
        return found.said != NOT_LINEAR and (self.seen is None or not differ(self.seen, found))

    def _by_table(self, found: Controller, start: int) -> bool:
        """Take over what a window shows, while the table is believed, or was never seen to be right."""
        if found.said == CONTRADICTED and not self._confirmed:
            # within a gap, say, a loop is linear, with another gain
            self.contradiction = self._law or found.cause
            self._are(found, start)
            self.change = None  # nobody has retuned what was never seen to be right
            return False
        self.contradiction = self._law
        if found.said in {AS_DECLARED, BESIDE}:
            self._confirmed |= _width(found) < SHARP_WIDTH
        else:
            self._loop = _with(self.table, found)
        return self._are(found, start)

    def _by_data(self, found: Controller, window: EventWindow, start: int, period: float) -> bool:
        """Take over what a window shows, while the settings of the data are believed."""
        self.contradiction = self._law
        if self.seen is not None and differ(self.seen, found) and self.table.kp is not None:
            back = see_controller(window, period, self.table)
            if back is not None and back.said in {AS_DECLARED, BESIDE}:
                self._loop = None
                return self._are(back, start)
        changed = self._are(found, start)
        if self.seen is not None:
            self._loop = _with(self.table, self.seen)
        return changed

    def _are(self, found: Controller, start: int) -> bool:
        """Note what a window from ``start`` [ns] on shows; return whether it is something else than before."""
        old = self.seen
        changed = old is not None and bool(differ(old, found))
        self._windows = [found] if changed else [*self._windows, found][-MOST_WINDOWS:]
        self.seen = combined(self._windows)
        self._note_delay(found)
        if changed and old is not None and old.settings is not None and found.settings is not None:
            self.change = Change(self._until, start, old.settings, found.settings)
        self.since = start if changed else self.since
        return changed

    def _note_delay(self, found: Controller) -> None:
        """Take over filter, delay and pace: a block does not lose them by a retune, nor where a window shows little."""
        delay = 0.0 if self.seen is None else max(self.seen.delay, found.delay)
        shows = found.explained is not None and found.explained >= SHOWS_DELAY_SHARE
        self.extra_delay = delay if shows else max(delay, self.extra_delay)


def _width(found: Controller) -> float:
    """Return the width of gain and integral time together, as shares; `UNKNOWN_WIDTH` for one without an end."""
    # no integral action is known as such
    parts = [i for i in (found.kp, found.ti) if not math.isinf(i.value)]
    widths = [(i.high - i.low) / abs(i.value) if i.value else math.inf for i in parts]
    return sum(w if math.isfinite(w) else UNKNOWN_WIDTH for w in widths)


def _from(window: EventWindow, start: int, since: int) -> tuple[EventWindow, int]:
    """Return the part of a window, which starts at ``start``, from a time on, with its own start [ns since 1970]."""
    first = int(np.searchsorted(start + (window.time - window.time[0]) * 1e9, since)) if len(window) else 0
    time, sp, pv, op = (getattr(window, name)[first:] for name in ("time", "sp", "pv", "op"))
    return EventWindow(time, sp, pv, op, max(window.before - first, 0)), max(start, since)


def _bare(loop: Loop) -> Loop:
    """Return a loop's row without settings."""
    return msgspec.structs.replace(loop, kp=None, ti=math.inf, td=0.0, tf=None)


def _with(loop: Loop, found: Controller) -> Loop:
    """Return a loop's row with the settings seen, in its own form where that can hold them."""
    settings, form = found.settings_in(loop.canonical_form), loop.form
    if settings is None:
        settings, form = found.settings, "standard"
    if settings is None:
        return loop
    kp, ti, td, tf = (float(x) for x in (settings.kp, settings.ti, settings.td, settings.tf))
    return msgspec.structs.replace(
        loop,
        form=form,
        kp=kp,
        ti=ti,
        td=td,
        tf=tf if td > 0 else None,
        b=float(settings.b),
        c=float(settings.c),
    )


def change_in_words(change: Change) -> str:
    """Say that settings have changed, when, and which ones.

    Examples
    --------
    >>> change = Change(0, 1_795_486_200 * 10**9, Settings(2.0, 60.0), Settings(3.5, 60.0))
    >>> change_in_words(change)
    'retuned on Tuesday 2026-11-24, 02:10 UTC, or shortly before: kp 2 to 3.5'
    """
    old, new = change.old, change.new
    pairs = [("kp", old.kp, new.kp, ""), ("ti", old.ti, new.ti, " s"), ("td", old.td, new.td, " s")]
    moved = [
        f"{name} {_short(float(a))} to {_short(float(b))}{unit}"
        for name, a, b, unit in pairs
        if not math.isclose(float(a), float(b), rel_tol=TOLD_SHARE)
    ]
    return f"retuned on {in_words(change.before)}, or shortly before: {', '.join(moved)}"


def _short(value: float) -> str:
    return f"{value:.3g}" if math.isfinite(value) else "none"
