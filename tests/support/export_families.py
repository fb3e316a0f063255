"""The same samples as plants' systems export them: shapes, names, times, separators, modes, qualities.

The layouts that `loopsight simulate` writes are families by themselves; the others vary what systems leave open.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from urllib.parse import quote

import numpy as np
import pandas as pd

from sim_plants.export import data_name, write_layout
from sim_plants.export_layouts import (
    LAYOUTS,
    PLAIN,
    Layout,
    Names,
    at,
    epoch,
    modes,
    naive,
    pattern,
    rows_of,
    suffixes,
    tag,
    tall,
    text,
    value,
    wide,
)

ZONE = "Europe/Berlin"
LOOPS = ("TIC-7", "LIC-42", "FIC-310")
START = np.datetime64("2026-03-14T07:30:00", "ns").astype(np.int64)
"""A day above 12: dates have one reading."""
AMBIGUOUS = np.datetime64("2026-03-02T07:30:00", "ns").astype(np.int64)


def base(n: int = 60, start: int = START, step_s: float = 5.0) -> pd.DataFrame:
    """Three loops, one in manual; numbers of three decimals; times in `ZONE`."""
    rng = np.random.default_rng(5)
    parts = []
    for k, name in enumerate(LOOPS):
        sp = np.where(np.arange(n) < n // 2, 40.0 + 10 * k, 42.5 + 10 * k)
        parts.append(
            pd.DataFrame(
                {
                    "loop": name,
                    "time": start + np.round(np.arange(n) * step_s * 1e9).astype(np.int64),
                    "sp": sp,
                    "pv": (sp + rng.normal(0, 0.3, n)).round(3),
                    "op": (55 + 3 * k + rng.normal(0, 1, n)).round(3),
                    "auto": k != 1,
                }
            )
        )
    data = pd.concat(parts, ignore_index=True)
    times = pd.to_datetime(data["time"], utc=True).dt.tz_convert(ZONE)
    return data.assign(time=times, loop=pd.Categorical(data["loop"], LOOPS))


@dataclass(frozen=True)
class Family:
    """One way to export, and whether it says the mode."""

    write: Callable[[pd.DataFrame, Path], Path]
    mode: bool = True
    start: int = START
    step_s: float = 5.0


def csv(make: Callable[[pd.DataFrame], pd.DataFrame], name: str = "export.csv", **how: object):
    def write(data: pd.DataFrame, folder: Path) -> Path:
        make(data).to_csv(folder / name, index=False, **how)  # type: ignore[call-overload]
        return folder / name

    return write


def lines(make: Callable[[pd.DataFrame], str], name: str = "export.csv", encoding: str = "utf-8"):
    def write(data: pd.DataFrame, folder: Path) -> Path:
        (folder / name).write_text(make(data), encoding=encoding, newline="")
        return folder / name

    return write


def simulated(layout: Layout) -> Callable[[pd.DataFrame, Path], Path]:
    """As `loopsight simulate` writes it."""

    def write(data: pd.DataFrame, folder: Path) -> Path:
        write_layout([data], layout, folder)
        return folder / data_name(layout)

    return write


def named(names: Names, **how: str) -> Callable[[pd.DataFrame, Path], Path]:
    return csv(lambda d: wide(d, names, **how))  # type: ignore[arg-type]


def in_zone(data: pd.DataFrame, zone: str) -> pd.DataFrame:
    return data.assign(time=data["time"].dt.tz_convert(zone))


def timed(form: str, zone: str = ZONE, heading: str = "Timestamp") -> Callable[[pd.DataFrame, Path], Path]:
    return csv(lambda d: wide(in_zone(d, zone), heading=heading, times=text(form)))


NAMES: dict[str, tuple[Names, dict[str, str]]] = {
    "site-prefix": (pattern("SITE1:{loop}_{role}", "SP", "PV", "OUT"), {}),
    "foxboro-colon": (pattern("AREA:{loop}.{role}", "SPT", "MEAS", "OUT"), {}),
    "co": (suffixes("_SP", "_PV", "_CO", "_MODE"), {"on": "1", "off": "0"}),
    "lower": (lambda n: {r: t.lower() for r, t in PLAIN(n).items()}, {}),
    "space": (suffixes(" SP", " PV", " OP", " Mode"), {"on": "Auto", "off": "Manual"}),
    "dash": (suffixes("-SP", "-PV", "-OUT"), {}),
    "slash": (suffixes("/SP", "/PV", "/OP"), {}),
    "bar": (suffixes("|SP", "|PV", "|OP"), {}),
    "colon": (suffixes(":SP", ":PV", ":OP"), {}),
    "words": (suffixes(".SetPoint", ".ProcessValue", ".Output", ".Mode"), {"on": "RCAS", "off": "ROUT"}),
    "words-apart": (
        suffixes(" - Set Point", " - Process Value", " - Controller Output", " - Mode"),
        {"on": "true", "off": "false"},
    ),
    "german": (
        suffixes(".Sollwert", ".Istwert", ".Stellwert", ".Betriebsart"),
        {"on": "Automatik", "off": "Hand"},
    ),
    "german-long": (
        suffixes("_Sollwert", "_Istwert", "_Stellgröße", "_Betriebsart"),
        {"on": "AUTO", "off": "HAND"},
    ),
    "a-m": (suffixes(".SP", ".PV", ".OP", ".A/M"), {"on": "A", "off": "M"}),
    "prefixed": (pattern("{role}_{loop}", "SP", "PV", "OP", "MODE"), {}),
    "server": (pattern(r"\\\\PISRV01\\{loop}.{role}", "SP", "PV", "OP"), {}),
    "ifix": (pattern("NODE1.{loop}_{role}.F_CV", "SP", "PV", "OP"), {}),
    "units-in-heading": (suffixes(".SP (%)", ".PV (%)", ".OP [%]"), {}),
    "trk": (PLAIN, {"on": "AUTO", "off": "TRK"}),
    "oos": (PLAIN, {"on": "CAS", "off": "OOS"}),
    "iman": (PLAIN, {"on": "AUTO", "off": "IMAN"}),
}

FORMS = {
    "dmy-name-upper-ms": "%d-%b-%Y %H:%M:%S.%f",
    "dmy-name-space": "%d %b %Y %H:%M:%S",
    "month-name-first": "%b %d, %Y %I:%M:%S %p",
    "us-24": "%m/%d/%Y %H:%M:%S",
    "us-short": "%m/%d/%y %H:%M:%S",
    "uk": "%d/%m/%Y %H:%M:%S",
    "dash-dmy": "%d-%m-%Y %H:%M:%S",
    "dotted": "%d.%m.%Y %H:%M:%S",
    "dotted-short": "%d.%m.%y %H:%M:%S",
    "iso": "%Y-%m-%dT%H:%M:%S",
    "slashed-ymd": "%Y/%m/%d %H:%M:%S",
    "compact": "%Y%m%d %H:%M:%S",
    "compact-14": "%Y%m%d%H%M%S",
    "compact-t": "%Y%m%dT%H%M%S",
    "weekday": "%a %d-%b-%Y %H:%M:%S",
    "time-first": "%H:%M:%S %d.%m.%Y",
    "offset": "%Y-%m-%dT%H:%M:%S%z",
}


def excel_serial(times: pd.Series) -> pd.Series:
    return (naive(times) - pd.Timestamp("1899-12-30")) / pd.Timedelta(days=1)


def date_and_time(form_date: str, form_time: str) -> Callable[[pd.DataFrame, Path], Path]:
    def make(d: pd.DataFrame) -> pd.DataFrame:
        table = wide(d, times=naive)
        t = table.pop("Timestamp")
        table.insert(0, "Time", t.dt.strftime(form_time))
        table.insert(0, "Date", t.dt.strftime(form_date))
        return table

    return csv(make)


def german_months(form: str, march: str, heading: str = "Timestamp") -> Callable[[pd.DataFrame, Path], Path]:
    return csv(lambda d: wide(d, heading=heading, times=lambda t: text(form)(t).str.replace("Mar", march)))


def tall_csv(columns: Mapping[str, object], **how: object) -> Callable[[pd.DataFrame, Path], Path]:
    return csv(rows_of(columns), **how)


LOCAL = at(text("%Y-%m-%d %H:%M:%S"))


def utc(rows: pd.DataFrame) -> pd.Series:
    return rows["time"].dt.tz_convert("UTC")


def tag_files(heading: str | None = "Value", nest: bool = False, head: bool = True, quality: bool = False):
    def write(data: pd.DataFrame, folder: Path) -> Path:
        for (name, loop, role), own in tall(data).groupby(["tag", "loop", "role"], observed=True):
            table = pd.DataFrame({"Timestamp": LOCAL(own), heading or str(name): own["value"]})
            if quality:
                table["Status"] = "Good"
            path = folder / "tags" / f"{quote(str(name), safe='')}.csv"
            if nest:
                path = folder / "tags" / str(loop) / f"{'MODE' if role == 'auto' else str(role).upper()}.csv"
            path.parent.mkdir(parents=True, exist_ok=True)
            table.to_csv(path, index=False, header=head)
        return folder / "tags"

    return write


def loop_files(**columns: str) -> Callable[[pd.DataFrame, Path], Path]:
    def table(data: pd.DataFrame) -> pd.DataFrame:
        own = data.assign(time=text("%d.%m.%Y %H:%M:%S")(data["time"]), auto=modes(data["auto"]))
        return own.rename(columns=columns)

    return simulated(Layout(table, split="loop"))


def xlsx(
    make: Callable[[pd.DataFrame], pd.DataFrame],
    rows_above: int = 0,
    sheets: bool = False,
    units: bool = False,
):
    def write(data: pd.DataFrame, folder: Path) -> Path:
        path = folder / "export.xlsx"
        table = make(data)
        with pd.ExcelWriter(path, engine="openpyxl") as book:
            if sheets:
                pd.DataFrame({"About": ["made by", "someone"]}).to_excel(book, sheet_name="Info", index=False)
            if units:
                table = pd.concat([pd.DataFrame([["%"] * len(table.columns)], columns=table.columns), table])
            table.to_excel(book, sheet_name="Data", index=False, startrow=rows_above)
            if rows_above:
                book.sheets["Data"]["A1"] = "Trend export of unit 3"
        return path

    return write


def parquet(make: Callable[[pd.DataFrame], pd.DataFrame], **how: object):
    def write(data: pd.DataFrame, folder: Path) -> Path:
        make(data).to_parquet(folder / "export.parquet", **how)  # type: ignore[call-overload]
        return folder / "export.parquet"

    return write


def with_title(d: pd.DataFrame) -> str:
    return "Plant report,,\nFrom:,14.03.2026 08:00:00,To:,14.03.2026 09:00:00\n\n" + wide(d).to_csv(
        index=False
    )


def with_units(d: pd.DataFrame) -> str:
    head, rest = wide(d).to_csv(index=False).split("\n", 1)
    return f"{head}\n" + ",".join(["", *["%"] * head.count(",")]) + f"\n{rest}"


def two_heading_rows(d: pd.DataFrame) -> str:
    table = wide(d, suffixes(".SP", ".PV", ".OP"))
    above = ";".join(["", *[f"{name};;" for name in LOOPS]])
    roles = ";".join(["Time", *["SP", "PV", "OP"] * len(LOOPS)])
    return f"{above}\n{roles}\n" + table.to_csv(index=False, header=False, sep=";", decimal=",")


def bad_texts(d: pd.DataFrame) -> pd.DataFrame:
    table = wide(d).astype(object)
    for k, word in enumerate(("Bad Input", "I/O Timeout", "No Data", "Shutdown", "#N/A", "Scan Off")):
        table.loc[3 + k, table.columns[1 + k]] = word
    return table


def target_and_actual(d: pd.DataFrame) -> pd.DataFrame:
    table = wide(d, suffixes(".SP", ".PV", ".OP", ".MODE.ACTUAL"))
    return table.assign(**{f"{name}.MODE.TARGET": "AUTO" for name in LOOPS})


def lake_with_words(d: pd.DataFrame) -> pd.DataFrame:
    names = {"time": "ts", "loop": "equipment", "sp": "SP", "pv": "PV", "op": "CO", "auto": "mode"}
    return d.assign(auto=modes(d["auto"])).rename(columns=names)


TALL: dict[str, Callable[[pd.DataFrame, Path], Path]] = {
    "wonderware-quality-only": tall_csv({"DateTime": LOCAL, "TagName": tag, "Value": value, "Quality": 0}),
    "ip21": tall_csv(
        {
            "NAME": tag,
            "IP_TREND_TIME": lambda r: at(text("%d-%b-%y %H:%M:%S.0"))(r).str.upper(),
            "IP_TREND_VALUE": value,
            "IP_TREND_QSTATUS": "Good",
        }
    ),
    "proficy-confidence": tall_csv({"tagname": tag, "timestamp": LOCAL, "value": value, "confidence": 100.0}),
    "ignition-sql": tall_csv(
        {
            "tagpath": lambda r: "area/" + r["tag"].str.replace(".", "/"),
            "floatvalue": value,
            "dataintegrity": 192,
            "t_stamp": at(epoch(10**6)),
        }
    ),
    "influx": tall_csv({"time": at(epoch(1)), "series name": tag, "value": value}),
    "loop-and-variable": tall_csv(
        {
            "ts": lambda r: utc(r).astype(str),
            "asset": lambda r: r["loop"],
            "variable": lambda r: r["role"].replace("auto", "mode"),
            "value": value,
        }
    ),
    "tall-german": tall_csv(
        {
            "Zeitstempel": at(text("%d.%m.%Y %H:%M:%S")),
            "Messstelle": tag,
            "Wert": lambda r: r["value"].str.replace(".", ","),
            "Status": "Good",
        },
        sep=";",
    ),
    "tall-tab": tall_csv({"Timestamp": LOCAL, "Tag": tag, "Value": value}, sep="\t"),
    "tall-by-tag": csv(
        lambda d: rows_of({"Tag": tag, "Time": LOCAL, "Value": value})(d).sort_values(["Tag", "Time"])
    ),
    "xlsx-tall": xlsx(
        lambda d: rows_of({"Timestamp": at(naive), "tag": tag, "Value": value})(d).assign(
            Value=lambda t: pd.to_numeric(t["Value"], errors="coerce").astype(object).fillna(t["Value"])
        )
    ),
    "parquet-tall": parquet(rows_of({"timestamp": utc, "tag": tag, "value": value}), index=False),
    "parquet-tall-numbers": parquet(
        lambda d: tall(d, on="1", off="0").assign(value=lambda r: r["value"].astype(float))[
            ["time", "tag", "value"]
        ],
        index=False,
    ),
    "parquet-tall-category": parquet(
        rows_of({"timestamp": utc, "tag": lambda r: r["tag"].astype("category"), "value": value}), index=False
    ),
}

FILES: dict[str, Callable[[pd.DataFrame, Path], Path]] = {
    "tag-files": tag_files(),
    "tag-files-heading": tag_files(heading=None),
    "tag-files-nested": tag_files(nest=True),
    "tag-files-no-heading": tag_files(head=False),
    "tag-files-quality": tag_files(quality=True),
    "loop-files": loop_files(time="Timestamp", sp="SP", pv="PV", op="OUT", auto="Mode"),
    "loop-files-words": loop_files(
        time="Date Time", sp="Set Point", pv="Process Value", op="Output", auto="Mode"
    ),
    "loop-files-german": loop_files(
        time="Zeit", sp="Sollwert", pv="Istwert", op="Stellwert", auto="Betriebsart"
    ),
    "xlsx-text-times": xlsx(wide),
    "xlsx-title": xlsx(lambda d: wide(d, times=naive), rows_above=3),
    "xlsx-second-sheet": xlsx(lambda d: wide(d, times=naive), sheets=True),
    "xlsx-units": xlsx(lambda d: wide(d, times=naive), units=True),
    "xlsx-serial": xlsx(lambda d: wide(d, times=excel_serial)),
    "lake-auto-word": parquet(lake_with_words, index=False),
    "parquet-index": parquet(lambda d: wide(in_zone(d, "UTC"), times=lambda t: t).set_index("Timestamp")),
    "parquet-unnamed-index": parquet(
        lambda d: wide(d, times=lambda t: t).set_index("Timestamp").rename_axis(None)
    ),
    "parquet-naive": parquet(lambda d: wide(d, times=naive), index=False),
    "parquet-strings": parquet(lambda d: wide(d).astype(str), index=False),
}

FAMILIES: dict[str, Family] = {
    **{f"layout-{name}": Family(simulated(layout)) for name, layout in LAYOUTS.items()},
    **{
        f"names-{key}": Family(named(names, **how), "auto" in names("X-1"))
        for key, (names, how) in NAMES.items()
    },
    "names-target-and-actual": Family(csv(target_and_actual)),
    **{f"time-{key}": Family(timed(form)) for key, form in FORMS.items()},
    "time-offset-chicago": Family(timed("%Y-%m-%dT%H:%M:%S%z", "America/Chicago")),
    "time-z": Family(timed("%Y-%m-%dT%H:%M:%SZ", "UTC")),
    "time-utc-word": Family(timed("%d-%b-%Y %H:%M:%S UTC", "UTC")),
    "time-german-month": Family(german_months("%d. %b %Y %H:%M:%S", "März", "Zeitstempel")),
    "time-german-short": Family(german_months("%d-%b-%y %H:%M:%S", "Mrz")),
    **{
        f"epoch-{unit}": Family(csv(partial(wide, heading="timestamp", times=epoch(scale))))
        for unit, scale in (("s", 10**9), ("ms", 10**6), ("us", 10**3), ("ns", 1))
    },
    "excel-serial": Family(csv(partial(wide, times=excel_serial))),
    "date-time-german": Family(date_and_time("%d.%m.%Y", "%H:%M:%S")),
    "date-time-us": Family(date_and_time("%m/%d/%Y", "%I:%M:%S %p")),
    "date-time-iso": Family(date_and_time("%Y-%m-%d", "%H:%M:%S")),
    "days-run": Family(timed("%d/%m/%Y %H:%M:%S"), start=AMBIGUOUS, step_s=7200.0),
    "semicolon-point": Family(csv(wide, sep=";")),
    "tab": Family(csv(wide, "export.txt", sep="\t")),
    "tab-comma-tsv": Family(csv(wide, "export.tsv", sep="\t", decimal=",")),
    "bar": Family(csv(wide, sep="|")),
    "comma-decimal-comma": Family(csv(wide, decimal=",")),
    "utf-16": Family(csv(wide, encoding="utf-16")),
    "utf-16-tab": Family(csv(wide, sep="\t", decimal=",", encoding="utf-16")),
    "cp1252": Family(csv(lambda d: wide(d, NAMES["german-long"][0]), encoding="cp1252")),
    "crlf": Family(csv(wide, lineterminator="\r\n")),
    "quoted": Family(csv(wide, quoting=1)),
    "titles": Family(lines(with_title)),
    "units": Family(lines(with_units)),
    "sep-line": Family(lines(lambda d: "sep=;\n" + wide(d).to_csv(index=False, sep=";"))),
    "two-heading-rows": Family(lines(two_heading_rows), mode=False),
    "bad-texts": Family(csv(bad_texts)),
    "extra-columns": Family(csv(lambda d: wide(d).assign(ambient=20.5, comment="x"))),
    **{name: Family(write) for name, write in {**TALL, **FILES}.items()},
}
