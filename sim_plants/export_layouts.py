"""How plants' systems lay out an export: samples in, their rows out; what writes them to files is `export.py`.

Samples are a frame with the columns ``loop`` (categories: all loops of the export), ``time`` (with a zone: the one in
which a text without zone is written), ``sp, pv, op`` and ``auto``, by time.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import TYPE_CHECKING, Any, TypeAlias

if TYPE_CHECKING:
    import pandas as pd

    Times: TypeAlias = "Callable[[pd.Series[pd.Timestamp]], pd.Series[Any]]"

Names: TypeAlias = Callable[[str], Mapping[str, str]]
"""Tags of a loop by role: ``sp``, ``pv``, ``op`` and, where the mode is told, ``auto``."""
ROLES = ("sp", "pv", "op", "auto")
LOST_EVERY_SAMPLES = 499
"""One PV of so many is a word in place of a value; a prime: it comes to every loop in turn."""


@dataclass(frozen=True, slots=True)
class Layout:
    """One way to write an export."""

    table: Callable[[Any], Any]
    """Samples to rows, frame to frame (no name of pandas: `--help` lists the layouts without loading it)."""
    suffix: str = ".csv"
    split: str = ""
    """Column by which the rows are parted into files, each called by its value; the column itself is left out."""
    above: str = ""
    """Lines above the headings."""
    csv: Mapping[str, str] = field(default_factory=dict)
    """``sep``, ``decimal``, ``encoding``."""


# -- names ------------------------------------------------------------------------------------------
def suffixes(sp: str, pv: str, op: str, auto: str = "") -> Names:
    """Return names that are the loop's with something behind it; ``auto`` may be left out."""
    return pattern("{loop}{role}", sp, pv, op, auto)


def pattern(tag: str, sp: str, pv: str, op: str, auto: str = "") -> Names:
    """Return names by a pattern of ``{loop}`` and ``{role}``, and the word for each role."""
    words = dict(zip(ROLES, (sp, pv, op, auto), strict=True))
    return lambda loop: {role: tag.format(loop=loop, role=word) for role, word in words.items() if word}


PLAIN = suffixes(".SP", ".PV", ".OP", ".MODE")
IGNITION = pattern("[default]Area1/{loop}/{role}", "SP", "PV", "OP", "Mode")
DELTAV = pattern("{loop}/PID1/{role}", "SP.CV", "PV.CV", "OUT.CV", "MODE.ACTUAL")
EXPERION = pattern("{loop}.DACA.{role}", "SP", "PV", "OP", "MODE")
YOKOGAWA = suffixes(".SV", ".PV", ".MV", ".MODE")
FOXBORO = suffixes(".SPT", ".MEAS", ".OUT", ".MA")
SIEMENS = suffixes(".SP", ".PV_IN", ".LMN", ".MODE")
ROCKWELL = suffixes(".SP", ".PV", ".CV", ".AUTO")


# -- times ------------------------------------------------------------------------------------------
def text(form: str) -> Times:
    """Return times as text by `strftime`; fractions of a second are added where there are any."""

    def write(times: pd.Series[pd.Timestamp]) -> pd.Series[str]:
        as_it_is = "%f" in form or bool((times == times.dt.floor("s")).all())
        return times.dt.strftime(form if as_it_is else form.replace("%S", "%S.%f"))

    return write


def epoch(unit: int) -> Times:
    """Return times as whole units [ns] since 1970 UTC."""
    return lambda times: times.dt.as_unit("ns").astype("int64") // unit


def with_offset(times: pd.Series[pd.Timestamp]) -> pd.Series[str]:
    """Return times as ISO text with the offset of their zone, ``+01:00``."""
    written = text("%Y-%m-%dT%H:%M:%S%z")(times)
    return written.str[:-2] + ":" + written.str[-2:]


def naive(times: pd.Series[pd.Timestamp]) -> pd.Series[pd.Timestamp]:
    """Return times of day without their zone, as a spreadsheet has them."""
    return times.dt.tz_localize(None)


ISO = text("%Y-%m-%d %H:%M:%S")
DAY_MONTH_NAME = text("%d-%b-%y %H:%M:%S")
US = text("%m/%d/%Y %I:%M:%S %p")


# -- shapes -----------------------------------------------------------------------------------------
def modes(auto: pd.Series[bool], on: str = "AUTO", off: str = "MAN") -> pd.Series[str]:
    """Return the words for automatic and manual."""
    return auto.map({True: on, False: off})


def wide(
    data: pd.DataFrame,
    names: Names = PLAIN,
    heading: str = "Timestamp",
    times: Times = ISO,
    on: str = "AUTO",
    off: str = "MAN",
) -> pd.DataFrame:
    """Return a row for each time, a column for each tag; empty where a loop has no sample at that time."""
    said = data.assign(auto=modes(data["auto"], on, off))
    # no pivot_table: a cell has one sample, and two of the same time are a mistake
    cells = said.pivot(index="time", columns="loop", values=list(ROLES))  # noqa: PD010
    tags = {
        (role, loop): tag for loop in data["loop"].cat.categories for role, tag in names(str(loop)).items()
    }
    table = cells.reindex(columns=list(tags)).set_axis(list(tags.values()), axis=1).infer_objects()
    table = table.reset_index(names=heading)
    return table.assign(**{heading: times(table[heading])})


def tall(data: pd.DataFrame, names: Names = PLAIN, on: str = "AUTO", off: str = "MAN") -> pd.DataFrame:
    """Return a row for each tag and time: ``loop, time, role, value, tag``; values are texts."""
    said = data.assign(
        auto=modes(data["auto"], on, off), **{role: data[role].astype(str) for role in ROLES[:3]}
    )
    tags = {str(loop): names(str(loop)) for loop in data["loop"].cat.categories}
    rows = said.melt(["loop", "time"], list(names("")), "role")
    keys = zip(rows["loop"].astype(str), rows["role"], strict=True)
    rows = rows.assign(tag=[tags[loop][role] for loop, role in keys])
    return rows.sort_values(["time", "tag"], kind="stable", ignore_index=True)


def with_words(data: pd.DataFrame, word: str) -> pd.DataFrame:
    """Return the samples with a historian's word in place of a PV now and then."""
    return data.assign(pv=data["pv"].astype(object).mask(data.index % LOST_EVERY_SAMPLES == 0, word))


def rows_of(
    columns: Mapping[str, Any], names: Names = PLAIN, word: str = ""
) -> Callable[[pd.DataFrame], pd.DataFrame]:
    """Return what writes tall rows under headings of its own.

    Parameters
    ----------
    columns
        What stands under each heading: a function of the rows, or the same in all of them.
    """

    def table(data: pd.DataFrame) -> pd.DataFrame:
        rows = tall(with_words(data, word) if word else data, names)
        return rows.assign(**columns)[list(columns)]

    return table


def at(times: Times) -> Callable[[pd.DataFrame], pd.Series[Any]]:
    """Return the times of rows, written so."""
    return lambda rows: times(rows["time"])


def tag(rows: pd.DataFrame) -> pd.Series[str]:
    """Return the tags of rows."""
    return rows["tag"]


def value(rows: pd.DataFrame) -> pd.Series[str]:
    """Return the values of rows, as text."""
    return rows["value"]


def _lake(data: pd.DataFrame) -> pd.DataFrame:
    names = {
        "time": "event_ts",
        "loop": "asset",
        "sp": "setpoint",
        "pv": "process_value",
        "op": "controller_output",
    }
    return data.assign(time=data["time"].dt.tz_convert("America/Chicago")).rename(columns=names)


def _long(data: pd.DataFrame) -> pd.DataFrame:
    return data.assign(time=with_offset(data["time"]))


_PI_TITLE = "Sampled Data,,,\nStart:,the first row,End:,the last row\n\n"

# -- systems ----------------------------------------------------------------------------------------
LAYOUTS: dict[str, Layout] = {
    "long": Layout(_long),
    "pi-datalink": Layout(lambda d: wide(with_words(d, "Bad Input"), times=DAY_MONTH_NAME)),
    "pi-title-rows": Layout(
        lambda d: wide(with_words(d, "I/O Timeout"), times=DAY_MONTH_NAME), above=_PI_TITLE
    ),
    "pi-us-times": Layout(partial(wide, times=US)),
    "pi-web": Layout(
        rows_of(
            {
                "Path": lambda r: "\\\\PI\\" + r["tag"],
                "Timestamp": at(with_offset),
                "Value": value,
                "Good": True,
                "Questionable": False,
                "Substituted": False,
                "UnitsAbbreviation": "%",
            }
        )
    ),
    "ip21-tall": Layout(
        rows_of(
            {
                "Name": tag,
                "Timestamp": at(text("%d-%b-%y %H:%M:%S")),
                "Value": value,
                "Quality": lambda r: r["value"].eq("No Data").map({True: "Bad", False: "Good"}),
            },
            word="No Data",
        )
    ),
    "wonderware": Layout(
        rows_of(
            {
                "DateTime": at(text("%Y-%m-%d %H:%M:%S.%f")),
                "TagName": tag,
                "Value": value,
                "Quality": 0,
                "QualityDetail": 192,
                "OPCQuality": 192,
            }
        )
    ),
    "proficy": Layout(rows_of({"Tagname": tag, "TimeStamp": at(US), "Value": value, "Quality": 100})),
    "ignition-wide": Layout(partial(wide, names=IGNITION, heading="t_stamp")),
    "ignition-tall": Layout(
        rows_of({"path": tag, "value": value, "quality": 192, "timestamp": at(epoch(10**6))}, IGNITION)
    ),
    "plain-tall": Layout(rows_of({"tag": tag, "time": at(text("%Y-%m-%dT%H:%M:%S")), "value": value})),
    "deltav": Layout(partial(wide, names=DELTAV, heading="Date-Time", times=with_offset)),
    "experion": Layout(partial(wide, names=EXPERION, on="CAS")),
    "yokogawa": Layout(partial(wide, names=YOKOGAWA, on="AUT")),
    "foxboro": Layout(partial(wide, names=FOXBORO)),
    "siemens": Layout(partial(wide, names=SIEMENS)),
    "rockwell": Layout(partial(wide, names=ROCKWELL, on="1", off="0")),
    "european": Layout(
        partial(wide, heading="Zeit", times=text("%d.%m.%Y %H:%M:%S")),
        csv={"sep": ";", "decimal": ",", "encoding": "utf-8-sig"},
    ),
    "excel": Layout(partial(wide, times=naive), ".xlsx"),
    "lake": Layout(_lake, ".parquet"),
    "one-file-per-tag": Layout(rows_of({"tag": tag, "Timestamp": at(ISO), "Value": value}), split="tag"),
    "one-file-per-loop": Layout(_long, split="loop"),
}
