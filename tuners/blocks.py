"""Vendor PID blocks as data (`blocks.toml`): the forms, fields, names and units of each."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass, field
from importlib.resources import files

TIME_UNITS = {"s": 1.0, "min": 60.0}  # seconds for one repeat or of derivative time
RATE_UNITS = {"1/s": 1.0, "1/min": 60.0, "1/h": 3600.0}  # seconds in the unit that a rate refers to


@dataclass(frozen=True, slots=True)
class Block:
    """A vendor's PID block; the keys of `blocks.toml`, where they are explained."""

    id: str
    name: str
    forms: list[str]
    gain: str
    integral: str
    integral_unit: str
    derivative: str
    derivative_unit: str
    source: str
    verified: bool
    form_field: str = ""
    form_values: dict[str, str] = field(default_factory=dict)
    gain_unit: str = "gain"
    gain_scale: float = 1.0
    basis: str = "percent"
    integral_scale: float = 1.0
    integral_off: float | None = None
    derivative_scale: float = 1.0
    filter: str = ""
    filter_unit: str = ""
    filter_ratio: float | None = None
    filter_range: list[float] = field(default_factory=list)
    structure_field: str = ""
    structures: dict[str, list[float]] = field(default_factory=dict)
    b_field: str = ""
    c_field: str = ""
    action: str = ""
    reverse: str = ""
    direct: str = ""
    constants: dict[str, float] = field(default_factory=dict)
    times: bool = False
    note: str = ""

    @property
    def form(self) -> str:
        """The form that the block computes unless it is set to another."""
        return self.forms[0]

    def __post_init__(self) -> None:
        if self.integral_unit not in TIME_UNITS | RATE_UNITS or self.derivative_unit not in TIME_UNITS:
            raise ValueError(f"{self.id}: unknown unit {self.integral_unit} or {self.derivative_unit}")


def _read() -> dict[str, Block]:
    text = files("tuners").joinpath("blocks.toml").read_text(encoding="utf-8")
    return {name: Block(id=name, **table) for name, table in tomllib.loads(text).items()}


BLOCKS = _read()  # every block by its id


def find_block(name: str) -> Block:
    """Return the block with this id.

    Raises
    ------
    ValueError
        For an unknown id, naming those that exist.

    Examples
    --------
    >>> find_block("deltav-pid").name
    'Emerson DeltaV PID'
    """
    if name not in BLOCKS:
        raise ValueError(f"block = {name!r}: must be one of {', '.join(BLOCKS)}")
    return BLOCKS[name]
