"""The loop table: what is known of each loop, checked once, at the door."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Iterator, Sequence

import msgspec

from tuners.blocks import BLOCKS
from tuners.models import INTEGRATING, SELF_REGULATING
from tuners.settings import FORMS, Settings

MOST_NAME_BYTES = 200
PROCESSES = ("auto", INTEGRATING, SELF_REGULATING)
OBJECTIVES = ("both", "setpoint", "load", "averaging")
CONTROLLERS = ("p", "pi", "pd", "pid")


class LoopTableError(ValueError):
    """A loop table that cannot be used; ``problems`` holds one line each."""

    def __init__(self, problems: Sequence[str]) -> None:
        super().__init__("\n".join(problems))
        self.problems = list(problems)


class Loop(msgspec.Struct, frozen=True, kw_only=True):
    """One loop. Names, units and defaults are those of the loop table's columns; None = not known.

    Examples
    --------
    >>> loop = Loop(name="LIC-101", kp=2.5, ti=80.0, op_low=0.0, op_high=100.0)
    >>> loop.structure, loop.op_span
    ('pi', 100.0)
    """

    name: str
    key: str = ""
    process: str = "auto"
    objective: str = "both"
    controller: str = ""
    allow_pd: bool = False
    form: str = "standard"
    b: float = 1.0
    c: float = 1.0
    kp: float | None = None
    ti: float = math.inf
    td: float = 0.0
    tf: float | None = None
    pv_low: float | None = None
    pv_high: float | None = None
    op_low: float | None = None
    op_high: float | None = None
    pv_filter: float | None = None
    scan: float | None = None
    closed_loop_time: float | None = None
    op_noise_max: float = 1.0
    max_load: float | None = None
    max_deviation: float | None = None
    master: str = ""
    period: float | None = None
    unit: str = ""
    """Of PV; empty where it is not known."""
    op_unit: str = ""
    """Of OP."""
    ci_min: float = 0.6
    ms_max: float = 2.2
    rule: str = ""
    """Tuning rule for suggestions; empty = the reference rule of the loop's structure."""

    @property
    def structure(self) -> str:
        """What a suggestion may use: as declared, else what the settings have; without settings ``pi``."""
        if self.controller:
            return self.controller
        if self.kp is None:
            return "pi"
        return {(True, False): "pi", (True, True): "pid", (False, False): "p", (False, True): "pd"}[
            (math.isfinite(self.ti), self.td > 0)
        ]

    @property
    def canonical_form(self) -> str:
        """The form that the loop's block computes."""
        if self.form in FORMS:
            return self.form
        return BLOCKS[self.form].form

    @property
    def filter_time(self) -> float:
        """Derivative filter time [s]: as given, else td/10."""
        return (self.td / 10 if self.tf is None else self.tf) if self.td > 0 else 0.0

    @property
    def settings(self) -> Settings | None:
        """Today's settings, canonical units, in the form of the block; None where they are not known."""
        if self.kp is None:
            return None
        return Settings(self.kp, self.ti, self.td, self.filter_time, self.canonical_form, self.b, self.c)

    @property
    def op_span(self) -> float | None:
        """Span of the output [OP], where both limits are known."""
        if self.op_low is None or self.op_high is None:
            return None
        return self.op_high - self.op_low


def offset_intended(loop: Loop) -> bool:
    """Whether an offset is meant: a surge vessel, or a controller declared without integral action."""
    return loop.objective == "averaging" or loop.controller in {"p", "pd"}


class LoopTable:
    """All loops, found by row, name or key.

    Examples
    --------
    >>> table = LoopTable([Loop(name="LIC-101"), Loop(name="PIC-205", key="plant/area1/PIC-205")])
    >>> table.by_name["PIC-205"], table[0].key
    (1, 'plant/LIC-101')
    """

    def __init__(self, loops: Iterable[Loop]) -> None:
        self.loops: list[Loop] = []
        self.by_name: dict[str, int] = {}
        self.by_key: dict[str, int] = {}
        self.empty: list[int] = []
        """Rows of loops that were removed, to be taken by the next that are added."""
        for loop in loops:
            self.add(loop)

    def add(self, loop: Loop) -> int:
        """Add a loop and return its row: an empty one, or a new one at the end.

        Raises
        ------
        ValueError
            Its name or key is taken.
        """
        if not loop.key:
            loop = msgspec.structs.replace(loop, key=default_key(loop.name))
        for taken, what in ((self.by_name, loop.name), (self.by_key, loop.key)):
            if what in taken:
                raise ValueError(f"loop {loop.name!r}: {what!r} is already taken by another loop")
        row = self.empty.pop() if self.empty else len(self.loops)
        self.by_name[loop.name] = self.by_key[loop.key] = row
        self.loops[row : row + 1] = [loop]
        return row

    def remove(self, row: int) -> None:
        """Forget a loop: its row stays where it is, empty, found by no name and no key."""
        loop = self.loops[row]
        del self.by_name[loop.name], self.by_key[loop.key]
        self.empty.append(row)

    def replace(self, row: int, loop: Loop) -> None:
        """Put new facts (settings) in place of a loop's; name and key stay."""
        old = self.loops[row]
        self.loops[row] = msgspec.structs.replace(loop, name=old.name, key=old.key)

    def __len__(self) -> int:
        return len(self.loops)

    def __getitem__(self, row: int) -> Loop:
        return self.loops[row]

    def __iter__(self) -> Iterator[Loop]:
        return iter(self.loops)


def default_key(name: str) -> str:
    """Return ``plant/<name>`` with all that Zenoh gives a meaning percent-encoded.

    Examples
    --------
    >>> default_key("LIC-101")
    'plant/LIC-101'
    >>> default_key("U1/LIC*")
    'plant/U1%2FLIC%2A'
    """

    def encode(match: re.Match[str]) -> str:
        return "".join(f"%{byte:02X}" for byte in match.group().encode())

    # cntrl: C0, DEL and C1; a leading @ would make the chunk verbatim
    return "plant/" + re.sub(r"[/*$?#%\x00-\x1f\x7f-\x9f]|^@", encode, name)
