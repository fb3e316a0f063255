"""What is looked at of an export to tell which column is what, and how it is refused where that is in doubt."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from .mapping import NO_MAPPING
from .mapping import ExportMapping as Given

HELP = "say which by a mapping: `loopsight import` writes one, --map takes it"


@dataclass(frozen=True, slots=True)
class Look:
    """An export's headings, and what stands beneath them."""

    path: Path
    headings: tuple[str, ...]
    kinds: Mapping[str, str]
    """Kind of each column, by its heading."""
    cells: Mapping[str, Sequence[str]]
    """First cells of each."""
    different: Callable[[tuple[str, ...]], Iterable[tuple[str, ...]]]
    """Every different row of these columns in the whole file."""
    known: Collection[str] = ()
    """Names of the loop table."""
    given: Given = field(default_factory=lambda: NO_MAPPING)
    """What the user says of the file."""


class DoubtError(ValueError):
    """A file that may be read in two ways, or in which something of a loop's mode cannot be used."""
