"""Columns as a historian writes them to columns of numbers: values, modes, qualities, names, ISO times.

Works on Arrow arrays through their own methods, without the library. What is well formed takes one compiled
cast; pandas reads what is not.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from monitor.contract.entries import MODE_UNKNOWN
from monitor.contract.quality import quality_of, scaled_quality
from monitor.contract.samples import QUALITY_GOOD
from monitor.contract.times import UNIT_NS

from .cell_kinds import stands_for_value
from .clock import DAY_FIRST, MONTH_FIRST
from .rows import Tally

_AUTOMATIC = (
    "auto aut a automatic automatik automatisch cas cascade kaskade c rcas true t 1 1.0 yes on wahr ein ja"
)
_MANUAL = "man manual m hand handbetrieb manuell h rout trk iman lo oos false f 0 0.0 no off falsch aus nein"
MODES = {**dict.fromkeys(_AUTOMATIC.split(), 1), **dict.fromkeys(_MANUAL.split(), 0)}
"""Text of a mode, lower case: only AUTO, CAS, RCAS are automatic; what is in neither list is unknown."""

MONTHS = 12
"""In a year: a larger number is a day's."""
_AWARE = re.compile(r"(?:Z|[+-]\d\d:?\d\d|[+-]\d\d)$")
_SLASHED = r"^(\d{1,2})/(\d{1,2})/(\d{4})"
_DOTTED = r"^(\d{1,2})\.(\d{1,2})\.(\d{4})"


def is_text(array: Any) -> bool:
    """Whether a column holds text (plain, large or view)."""
    return "string" in str(array.type) or "binary" in str(array.type)


def plain(array: Any) -> Any:
    """Return a column without its dictionary, bytes as text."""
    if str(array.type).startswith("dictionary"):
        array = array.dictionary_decode()
    return array.cast("string") if "binary" in str(array.type) else array


def numbers(array: Any, tally: Tally, *, comma: bool = False) -> NDArray[np.float64]:
    """Read a column of values; text and empty cells are NaN, and counted.

    Parameters
    ----------
    comma
        Decimal commas may occur: 1,5. Otherwise a comma makes it text, for it may be one of thousands.

    Raises
    ------
    ValueError
        The column is of a type that has nothing to do with numbers.
    """
    array = plain(array)
    if is_text(array):
        try:
            array = array.cast("double")
        except ValueError:
            return _numbers_among_text(array, tally, comma)
    kind = str(array.type)
    if kind in {"double", "float", "halffloat"}:
        out = array.to_numpy(zero_copy_only=False)
        return np.ascontiguousarray(out, dtype=np.float64)
    if not kind.startswith(("int", "uint", "decimal", "bool", "null")):
        raise ValueError(f"a column of type {kind}, expected numbers")
    if kind == "bool":
        array = array.cast("int8")
    return np.array(array.cast("double", safe=False).to_numpy(zero_copy_only=False), dtype=np.float64)


def _numbers_among_text(array: Any, tally: Tally, comma: bool) -> NDArray[np.float64]:
    import pandas as pd  # noqa: PLC0415 (half a second; only for what a plain cast refuses)

    text = array.to_pandas().str.strip()
    pointed = text
    if comma:  # a point before a comma groups thousands: 1.234,5
        pointed = text.str.replace(r"\.(?=.*,)", "", regex=True).str.replace(",", ".", regex=False)
    else:
        grouped = text.str.match(r"^[+-]?\d{1,3}(?:,\d{3})+\.\d+$").fillna(value=False)
        if grouped.any():  # a comma before a point does: 1,234.5
            pointed = text.where(~grouped, text.str.replace(",", "", regex=False))
    values = pd.to_numeric(pointed, errors="coerce").to_numpy(np.float64, na_value=np.nan)
    odd = text[np.isnan(values)].dropna()
    for value, times in odd[~odd.str.lower().isin(["nan", "-nan"])].value_counts().items():
        tally.count_text(str(value), int(times))
    return np.array(values)


def modes(
    array: Any, tally: Tally, said: Mapping[str, int] | None = None, strange: int = MODE_UNKNOWN
) -> NDArray[np.int8]:
    """Read the mode: 1 automatic, 0 manual, -1 where the cell does not say.

    Parameters
    ----------
    said
        What the user says of a text or number, lower case: 1 or 0.
    strange
        What a word means that is in no list, and stands for no bad value either.
    """
    said = said or {}
    array = plain(array)
    if str(array.type) == "bool":
        return np.array(
            array.cast("int8").fill_null(MODE_UNKNOWN).to_numpy(zero_copy_only=False), dtype=np.int8
        )
    if not is_text(array):
        number = numbers(array, tally)
        if said:
            array = array.cast("string")
            return _by_text(array, lambda t, _: said.get(_number_text(t), MODE_UNKNOWN), MODE_UNKNOWN).astype(
                np.int8
            )
        return np.select([number == 1, number == 0], [1, 0], MODE_UNKNOWN).astype(np.int8)

    def mode(text: str, times: int) -> int:
        key = text.strip().lower()
        known = said.get(_number_text(key), MODES.get(key, MODE_UNKNOWN))
        if known == MODE_UNKNOWN and text.strip():
            tally.count_text(text.strip(), times)
            return MODE_UNKNOWN if stands_for_value(text) else strange
        return known

    return _by_text(array, mode, MODE_UNKNOWN).astype(np.int8)


def _number_text(text: str) -> str:
    """Return a number's text without a fraction of zeros: ``16.0`` is ``16``."""
    return text.removesuffix(".0")


def qualities(array: Any, tally: Tally, scale: str = "") -> NDArray[np.uint8]:
    """Read the quality as an OPC code, from a code (OPC, OPC UA), a text or a bool; an empty cell is good.

    What is not good is kept in the tally, as it stood there.

    Parameters
    ----------
    scale
        Of numbers, where it is another than OPC's: a name of `QUALITY_SCALES`.
    """
    array = plain(array)
    if str(array.type) == "bool":
        array = array.cast("string")
    if not is_text(array):
        codes = numbers(array, Tally())
        out = scaled_quality(codes, scale)
        for code, times in zip(*np.unique(codes[out < QUALITY_GOOD], return_counts=True), strict=True):
            tally.count_quality(f"{code:.15g}", int(times))
        return out

    def quality(text: str, times: int) -> int:
        code = quality_of(text)
        if scale and text.strip().replace(".", "", 1).isdigit():
            code = int(scaled_quality(np.array([float(text)]), scale)[0])
        if code < QUALITY_GOOD:
            tally.count_quality(text.strip(), times)
        return code

    return _by_text(array, quality, QUALITY_GOOD).astype(np.uint8)


def _by_text(array: Any, meaning: Callable[[str, int], int], missing: int) -> NDArray[np.int64]:
    """Look up each different text once; ``meaning`` takes it and how often it stands there."""
    encoded = array.dictionary_encode()
    texts = encoded.dictionary.to_pylist()
    index = encoded.indices.fill_null(len(texts)).to_numpy(zero_copy_only=False)
    times = np.bincount(index, minlength=len(texts) + 1)
    table = np.array([*(meaning(t, int(n)) for t, n in zip(texts, times, strict=False)), missing], np.int64)
    return np.asarray(table[index])


def codes_of(array: Any, code: Callable[[str | None], int]) -> NDArray[np.int32]:
    """Return the code of the loop that each row names; each different name is looked up once."""
    if not str(array.type).startswith("dictionary"):
        array = (array if is_text(array) else array.cast("string")).dictionary_encode()
    names = plain(array.dictionary) if is_text(array.dictionary) else array.dictionary.cast("string")
    index = array.indices
    table = np.array([*map(code, names.to_pylist()), code(None) if index.null_count else -1], np.int32)
    if index.null_count:
        index = index.cast("int64").fill_null(len(table) - 1)
    return np.asarray(table[index.to_numpy(zero_copy_only=False)])


def stamps(array: Any) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """Read timestamps of any unit: (N,) [ns], UTC where they have a zone; (N,) whether usable."""
    scale = UNIT_NS[re.split(r"[\[\],]", str(array.type))[1]]
    good, raw = np.ones(len(array), np.bool_), array.cast("int64")
    if raw.null_count:
        good, raw = (
            ~np.asarray(raw.is_null().to_numpy(zero_copy_only=False), dtype=np.bool_),
            raw.fill_null(0),
        )
    raw = raw.to_numpy(zero_copy_only=False)
    if scale > 1:
        most = np.iinfo(np.int64).max // scale
        if len(raw) and (raw.max() > most or raw.min() < -most):
            good = good & (raw <= most) & (raw >= -most)
        raw = np.where(good, raw, 0) * scale
    return np.asarray(raw, dtype=np.int64), good


def order_of(array: Any) -> str:
    """Tell whether dates with slashes name the day or the month first; empty where there are none.

    Raises
    ------
    ValueError
        Each may be either.
    """
    parts = plain(array).to_pandas().astype("str").str.strip().str.extract(_SLASHED).dropna().astype("int64")
    if not len(parts):
        return ""
    day_first, month_first = bool((parts[0] > MONTHS).any()), bool((parts[1] > MONTHS).any())
    if day_first == month_first:
        shown = "/".join(f"{n:02d}" for n in parts.iloc[0])
        kind = "both" if day_first else "either"
        raise ValueError(
            f"time: dates like {shown} name the day or the month first, {kind}; expected ISO text"
        )
    return DAY_FIRST if day_first else MONTH_FIRST


def text_times(
    array: Any, zoned: Any, order: str = ""
) -> tuple[NDArray[np.int64], NDArray[np.bool_], NDArray[np.bool_]]:
    """Read ISO times (also ``31.12.2024 23:59:59,5``, and ``31/12/2024 23:59:59`` where the order is known).

    Parameters
    ----------
    zoned
        The Arrow type of a time with zone, which has no name to ask for it by.
    order
        Of day and month, as `order_of` says.

    Returns
    -------
    time, good, aware
        (N,) [ns], local where not ``aware`` of a zone; (N,) whether the text is a time.
    """
    array = plain(array)
    everywhere = np.ones(len(array), np.bool_)
    if not array.null_count:
        # the likely kind first: a cast that fails for each cell takes fifty times as long
        first = str(array[0]) if len(array) else ""
        kinds = [("timestamp[ns]", False), (zoned, True)]
        for kind, aware in kinds[::-1] if _AWARE.search(first[10:]) else kinds:
            try:
                ns = array.cast(kind).cast("int64").to_numpy(zero_copy_only=False)
            except ValueError:
                continue
            return ns, everywhere, everywhere if aware else ~everywhere
    return _odd_times(array, order)


def _odd_times(array: Any, order: str) -> tuple[NDArray[np.int64], NDArray[np.bool_], NDArray[np.bool_]]:
    import pandas as pd  # noqa: PLC0415 (half a second; only for what a plain cast refuses)

    text = array.to_pandas().astype("str").str.strip().str.replace(",", ".", regex=False)
    text = text.str.replace(_DOTTED, r"\3-\2-\1", regex=True)
    if order:
        date = r"\3-\2-\1" if order == DAY_FIRST else r"\3-\1-\2"
        text = text.str.replace(r"^(\d)/", r"0\1/", regex=True).str.replace(r"/(\d)/", r"/0\1/", regex=True)
        text = text.str.replace(_SLASHED, date, regex=True)
    aware = text.str.contains(_AWARE).fillna(value=False).to_numpy(np.bool_)
    # a date's own hyphens look like an offset: 2024-08-24
    aware = aware & (text.str.len() > len("2024-08-24")).fillna(value=False).to_numpy(np.bool_)
    parsed = pd.to_datetime(text, format="ISO8601", errors="coerce", utc=True)
    year = parsed.dt.year
    good = ((year > 1677) & (year < 2262)).fillna(value=False).to_numpy(np.bool_)
    ns = parsed.where(good).dt.as_unit("ns").astype("int64").to_numpy(np.int64)
    return np.where(good, ns, 0), good, aware
