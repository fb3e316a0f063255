"""Historian exports in, tables out: Parquet and CSV, the columns of a file and nothing about their meaning in time.

A file is looked at once (`inspect`: format, layout, clock, all bounds) and then read in batches (`read`), so
that memory does not grow with history. Nothing is resampled; what cannot be read is counted in a `Tally`.
"""

from __future__ import annotations

import codecs
import csv
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.csv as pa_csv
import pyarrow.parquet as pq
from numpy.typing import NDArray

from .cells import CellsError, codes_of, modes, numbers, qualities, text_times
from .layouts import LONG, TIME, WIDE, Layout, layout_of, normal_name
from .rows import MOST_LINES, Rows, Tally, UnusableError, join_rows
from .times import Clock, clock_of_numbers, numbers_to_ns, plausible
