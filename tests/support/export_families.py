"""The same samples as plants' systems export them: shapes, names, times, separators, modes, qualities."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import quote

import numpy as np
import pandas as pd

ZONE = "Europe/Berlin"
LOOPS = ("TIC-7", "LIC-42", "FIC-310")
START = np.datetime64("2026-03-14T07:30:00", "ns").astype(np.int64)
"""A day above 12: dates have one reading."""
AMBIGUOUS = np.datetime64("2026-03-02T07:30:00", "ns").astype(np.int64)


def base(n: int = 60, start: int = START, step_s: float = 5.0) -> pd.DataFrame:
    """Three loops, one in manual; numbers of three decimals; UTC."""
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
    return pd.concat(parts, ignore_index=True)


def utc(data: pd.DataFrame) -> pd.Series:
    return pd.to_datetime(data["time"], utc=True)


def local(data: pd.DataFrame) -> pd.Series:
    return utc(data).dt.tz_convert(ZONE).dt.tz_localize(None)


Names = Callable[[str], Mapping[str, str]]


def suffixes(sp: str, pv: str, op: str, auto: str = "") -> Names:
    return lambda n: {"sp": n + sp, "pv": n + pv, "op": n + op} | ({"auto": n + auto} if auto else {})


PLAIN = suffixes(".SP", ".PV", ".OP", ".MODE")


def modes(auto: pd.Series, on: str = "AUTO", off: str = "MAN") -> pd.Series:
    return auto.map({True: on, False: off})


def wide(
    data: pd.DataFrame, names: Names = PLAIN, heading: str = "Timestamp", times: pd.Series | None = None,
    on: str = "AUTO", off: str = "MAN",
) -> pd.DataFrame:  # fmt: skip
    """A row for each time, a column for each tag."""
    times = local(data).dt.strftime("%Y-%m-%d %H:%M:%S") if times is None else times
    out: pd.DataFrame | None = None
    for name, part in data.assign(t=times).groupby("loop", sort=False):
        own = pd.DataFrame({heading: part["t"].to_numpy()})
        for role, tag in names(str(name)).items():
            own[tag] = (modes(part["auto"], on, off) if role == "auto" else part[role]).to_numpy()
        out = own if out is None else out.merge(own, on=heading)
    assert out is not None
    return out


def tall(data: pd.DataFrame, names: Names = PLAIN, on: str = "AUTO", off: str = "MAN") -> pd.DataFrame:
    """A row for each tag and time: ``tag, at (UTC), value, role, loop``."""
    parts = []
    for name, part in data.groupby("loop", sort=False):
        for role, tag in names(str(name)).items():
            value = modes(part["auto"], on, off) if role == "auto" else part[role].astype(str)
            parts.append(
                pd.DataFrame(
                    {
                        "tag": tag,
                        "at": part["time"].to_numpy(),
                        "value": value.to_numpy(),
                        "role": role,
                        "loop": name,
                    }
                )
            )
    return pd.concat(parts).sort_values(["at", "tag"], kind="stable", ignore_index=True)


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


def text(make: Callable[[pd.DataFrame], str], name: str = "export.csv", encoding: str = "utf-8"):
    def write(data: pd.DataFrame, folder: Path) -> Path:
        (folder / name).write_text(make(data), encoding=encoding, newline="")
        return folder / name

    return write


def named(names: Names, **how: str) -> Callable[[pd.DataFrame, Path], Path]:
    return csv(lambda d: wide(d, names, **how))


def timed(form: str, zone: str | None = ZONE, **names: str) -> Callable[[pd.DataFrame, Path], Path]:
    def make(d: pd.DataFrame) -> pd.DataFrame:
        times = utc(d) if zone is None else utc(d).dt.tz_convert(zone)
        return wide(d, times=times.dt.strftime(form), **names)  # type: ignore[arg-type]

    return csv(make)


GERMAN = {"Mar": "Mrz", "May": "Mai", "Oct": "Okt", "Dec": "Dez"}

NAMES: dict[str, tuple[Names, dict[str, str]]] = {
    "ignition": (
        lambda n: {
            r: f"[default]Area1/{n}/{w}"
            for r, w in zip(("sp", "pv", "op", "auto"), ("SP", "PV", "OP", "Mode"), strict=True)
        },
        {},
    ),
    "site-prefix": (
        lambda n: {r: f"SITE1:{n}_{w}" for r, w in zip(("sp", "pv", "op"), ("SP", "PV", "OUT"), strict=True)},
        {},
    ),
    "deltav": (
        lambda n: {
            r: f"{n}/PID1/{w}"
            for r, w in zip(
                ("sp", "pv", "op", "auto"), ("SP.CV", "PV.CV", "OUT.CV", "MODE.ACTUAL"), strict=True
            )
        },
        {},
    ),
    "experion": (
        lambda n: {
            r: f"{n}.DACA.{w}"
            for r, w in zip(("sp", "pv", "op", "auto"), ("SP", "PV", "OP", "MODE"), strict=True)
        },
        {"on": "CAS", "off": "MAN"},
    ),
    "yokogawa": (suffixes(".SV", ".PV", ".MV", ".MODE"), {"on": "AUT", "off": "MAN"}),
    "foxboro": (suffixes(".SPT", ".MEAS", ".OUT", ".MA"), {}),
    "foxboro-colon": (lambda n: {"sp": f"AREA:{n}.SPT", "pv": f"AREA:{n}.MEAS", "op": f"AREA:{n}.OUT"}, {}),
    "siemens": (suffixes(".SP", ".PV_IN", ".LMN"), {}),
    "rockwell": (suffixes(".SP", ".PV", ".CV"), {}),
    "co": (suffixes("_SP", "_PV", "_CO", "_MODE"), {"on": "1", "off": "0"}),
    "lower": (
        lambda n: {r: f"{n}.{r}".lower() for r in ("sp", "pv", "op")} | {"auto": f"{n}.mode".lower()},
        {},
    ),
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
    "auto": (suffixes(".SP", ".PV", ".OP", ".AUTO"), {"on": "1", "off": "0"}),
    "prefixed": (lambda n: {"sp": f"SP_{n}", "pv": f"PV_{n}", "op": f"OP_{n}", "auto": f"MODE_{n}"}, {}),
    "server": (lambda n: {r: rf"\\PISRV01\{n}.{r.upper()}" for r in ("sp", "pv", "op")}, {}),
    "ifix": (lambda n: {r: f"NODE1.{n}_{r.upper()}.F_CV" for r in ("sp", "pv", "op")}, {}),
    "units-in-heading": (suffixes(".SP (%)", ".PV (%)", ".OP [%]"), {}),
    "trk": (suffixes(".SP", ".PV", ".OP", ".MODE"), {"on": "AUTO", "off": "TRK"}),
    "oos": (suffixes(".SP", ".PV", ".OP", ".MODE"), {"on": "CAS", "off": "OOS"}),
    "iman": (suffixes(".SP", ".PV", ".OP", ".MODE"), {"on": "AUTO", "off": "IMAN"}),
    "target-and-actual": (lambda n: {**PLAIN(n), "auto": f"{n}.MODE.ACTUAL"}, {}),
}

FORMS = {
    "dmy-name": "%d-%b-%y %H:%M:%S",
    "dmy-name-upper-ms": "%d-%b-%Y %H:%M:%S.%f",
    "dmy-name-space": "%d %b %Y %H:%M:%S",
    "month-name-first": "%b %d, %Y %I:%M:%S %p",
    "us": "%m/%d/%Y %I:%M:%S %p",
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
}


def epoch(unit: int) -> Callable[[pd.DataFrame, Path], Path]:
    return csv(lambda d: wide(d, heading="timestamp", times=d["time"] // unit))


def excel_serial(d: pd.DataFrame) -> pd.Series:
    return (local(d) - pd.Timestamp("1899-12-30")) / pd.Timedelta(days=1)


def date_and_time(form_date: str, form_time: str) -> Callable[[pd.DataFrame, Path], Path]:
    def make(d: pd.DataFrame) -> pd.DataFrame:
        table = wide(d)
        t = pd.to_datetime(table.pop("Timestamp"))
        table.insert(0, "Time", t.dt.strftime(form_time))
        table.insert(0, "Date", t.dt.strftime(form_date))
        return table

    return csv(make)


def tall_csv(make: Callable[[pd.DataFrame], pd.DataFrame], names: Names = PLAIN, **how: object):
    def write(data: pd.DataFrame, folder: Path) -> Path:
        rows = tall(data, names)
        rows["local"] = pd.to_datetime(rows["at"], utc=True).dt.tz_convert(ZONE).dt.tz_localize(None)
        make(rows).to_csv(folder / "export.csv", index=False, **how)  # type: ignore[call-overload]
        return folder / "export.csv"

    return write


def local_text(rows: pd.DataFrame, form: str = "%Y-%m-%d %H:%M:%S") -> pd.Series:
    return rows["local"].dt.strftime(form)


def tag_files(heading: str | None = "Value", nest: bool = False, head: bool = True, quality: bool = False):
    def write(data: pd.DataFrame, folder: Path) -> Path:
        rows = tall(data)
        rows["local"] = pd.to_datetime(rows["at"], utc=True).dt.tz_convert(ZONE).dt.tz_localize(None)
        for (tag, loop, role), own in rows.groupby(["tag", "loop", "role"]):
            table = pd.DataFrame({"Timestamp": local_text(own), heading or str(tag): own["value"]})
            if quality:
                table["Status"] = "Good"
            path = folder / "tags" / f"{quote(str(tag), safe='')}.csv"
            if nest:
                path = folder / "tags" / str(loop) / f"{'MODE' if role == 'auto' else str(role).upper()}.csv"
            path.parent.mkdir(parents=True, exist_ok=True)
            table.to_csv(path, index=False, header=head)
        return folder / "tags"

    return write


def loop_files(columns: Mapping[str, str], suffix: str = ".csv"):
    def write(data: pd.DataFrame, folder: Path) -> Path:
        (folder / "loops").mkdir()
        for name, own in data.assign(time=local(data).dt.strftime("%d.%m.%Y %H:%M:%S")).groupby("loop"):
            table = own.drop(columns="loop").assign(auto=modes(own["auto"])).rename(columns=dict(columns))
            table.to_csv(folder / "loops" / f"{name}{suffix}", index=False)
        return folder / "loops"

    return write


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


def long(data: pd.DataFrame, **names: str) -> pd.DataFrame:
    return data.assign(time=utc(data)).rename(columns=names)


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
    table = wide(d, NAMES["target-and-actual"][0])
    for name in LOOPS:
        table[f"{name}.MODE.TARGET"] = "AUTO"
    return table


FAMILIES: dict[str, Family] = {
    **{
        f"names-{key}": Family(named(names, **how), "auto" in names("X-1"))
        for key, (names, how) in NAMES.items()
        if key != "target-and-actual"
    },
    "names-target-and-actual": Family(csv(target_and_actual)),
    **{f"time-{key}": Family(timed(form)) for key, form in FORMS.items()},
    "time-offset": Family(timed("%Y-%m-%dT%H:%M:%S%z")),
    "time-offset-chicago": Family(timed("%Y-%m-%dT%H:%M:%S%z", "America/Chicago")),
    "time-z": Family(timed("%Y-%m-%dT%H:%M:%SZ", None)),
    "time-utc-word": Family(timed("%d-%b-%Y %H:%M:%S UTC", None)),
    "time-german-month": Family(
        csv(
            lambda d: wide(
                d,
                heading="Zeitstempel",
                times=local(d).dt.strftime("%d. %b %Y %H:%M:%S").str.replace("Mar", "März"),
            )
        )
    ),
    "time-german-short": Family(
        csv(lambda d: wide(d, times=local(d).dt.strftime("%d-%b-%y %H:%M:%S").str.replace("Mar", "Mrz")))
    ),
    **{
        f"epoch-{unit}": Family(epoch(scale))
        for unit, scale in (("s", 10**9), ("ms", 10**6), ("us", 10**3), ("ns", 1))
    },
    "excel-serial": Family(csv(lambda d: wide(d, times=excel_serial(d)))),
    "date-time-german": Family(date_and_time("%d.%m.%Y", "%H:%M:%S")),
    "date-time-us": Family(date_and_time("%m/%d/%Y", "%I:%M:%S %p")),
    "date-time-iso": Family(date_and_time("%Y-%m-%d", "%H:%M:%S")),
    "days-run": Family(timed("%d/%m/%Y %H:%M:%S"), start=AMBIGUOUS, step_s=7200.0),
    "semicolon-comma": Family(csv(wide, sep=";", decimal=",", encoding="utf-8-sig")),
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
    "titles": Family(text(with_title)),
    "units": Family(text(with_units)),
    "sep-line": Family(text(lambda d: "sep=;\n" + wide(d).to_csv(index=False, sep=";"))),
    "two-heading-rows": Family(text(two_heading_rows), mode=False),
    "bad-texts": Family(csv(bad_texts)),
    "extra-columns": Family(csv(lambda d: wide(d).assign(ambient=20.5, comment="x"))),
    "wonderware": Family(
        tall_csv(
            lambda r: pd.DataFrame(
                {
                    "DateTime": local_text(r, "%Y-%m-%d %H:%M:%S.%f").str[:-3],
                    "TagName": r["tag"],
                    "Value": r["value"],
                    "Quality": 0,
                    "QualityDetail": 192,
                    "OPCQuality": 192,
                }
            )
        )
    ),
    "wonderware-quality-only": Family(
        tall_csv(
            lambda r: pd.DataFrame(
                {"DateTime": local_text(r), "TagName": r["tag"], "Value": r["value"], "Quality": 0}
            )
        )
    ),
    "ip21": Family(
        tall_csv(
            lambda r: pd.DataFrame(
                {
                    "NAME": r["tag"],
                    "IP_TREND_TIME": local_text(r, "%d-%b-%y %H:%M:%S.0").str.upper(),
                    "IP_TREND_VALUE": r["value"],
                    "IP_TREND_QSTATUS": "Good",
                }
            )
        )
    ),
    "proficy": Family(
        tall_csv(
            lambda r: pd.DataFrame(
                {
                    "Tagname": r["tag"],
                    "TimeStamp": local_text(r, "%m/%d/%Y %I:%M:%S %p"),
                    "Value": r["value"],
                    "Quality": 100,
                }
            )
        )
    ),
    "proficy-confidence": Family(
        tall_csv(
            lambda r: pd.DataFrame(
                {"tagname": r["tag"], "timestamp": local_text(r), "value": r["value"], "confidence": 100.0}
            )
        )
    ),
    "pi-web": Family(
        tall_csv(
            lambda r: pd.DataFrame(
                {
                    "Path": "\\\\PI\\" + r["tag"],
                    "Timestamp": pd.to_datetime(r["at"], utc=True).dt.strftime("%Y-%m-%dT%H:%M:%SZ"),
                    "Value": r["value"],
                    "Good": True,
                    "Questionable": False,
                    "Substituted": False,
                    "UnitsAbbreviation": "%",
                }
            )
        )
    ),
    "ignition-tall": Family(
        tall_csv(
            lambda r: pd.DataFrame(
                {
                    "path": "[default]Area1/" + r["tag"].str.replace(".", "/"),
                    "value": r["value"],
                    "quality": 192,
                    "timestamp": r["at"] // 10**6,
                }
            )
        )
    ),
    "ignition-sql": Family(
        tall_csv(
            lambda r: pd.DataFrame(
                {
                    "tagpath": "area/" + r["tag"].str.replace(".", "/"),
                    "floatvalue": r["value"],
                    "dataintegrity": 192,
                    "t_stamp": r["at"] // 10**6,
                }
            )
        )
    ),
    "influx": Family(
        tall_csv(lambda r: pd.DataFrame({"time": r["at"], "series name": r["tag"], "value": r["value"]}))
    ),
    "loop-and-variable": Family(
        tall_csv(
            lambda r: pd.DataFrame(
                {
                    "ts": pd.to_datetime(r["at"], utc=True).astype(str),
                    "asset": r["loop"],
                    "variable": r["role"].replace("auto", "mode"),
                    "value": r["value"],
                }
            )
        )
    ),
    "tall-german": Family(
        tall_csv(
            lambda r: pd.DataFrame(
                {
                    "Zeitstempel": local_text(r, "%d.%m.%Y %H:%M:%S"),
                    "Messstelle": r["tag"],
                    "Wert": r["value"].str.replace(".", ","),
                    "Status": "Good",
                }
            ),
            sep=";",
        )
    ),
    "tall-tab": Family(
        tall_csv(
            lambda r: pd.DataFrame({"Timestamp": local_text(r), "Tag": r["tag"], "Value": r["value"]}),
            sep="\t",
        )
    ),
    "tall-by-tag": Family(
        tall_csv(
            lambda r: pd.DataFrame({"Tag": r["tag"], "Time": local_text(r), "Value": r["value"]}).sort_values(
                ["Tag", "Time"]
            )
        )
    ),
    "tag-files": Family(tag_files()),
    "tag-files-heading": Family(tag_files(heading=None)),
    "tag-files-nested": Family(tag_files(nest=True)),
    "tag-files-no-heading": Family(tag_files(head=False)),
    "tag-files-quality": Family(tag_files(quality=True)),
    "loop-files": Family(
        loop_files({"time": "Timestamp", "sp": "SP", "pv": "PV", "op": "OUT", "auto": "Mode"})
    ),
    "loop-files-words": Family(
        loop_files(
            {"time": "Date Time", "sp": "Set Point", "pv": "Process Value", "op": "Output", "auto": "Mode"}
        )
    ),
    "loop-files-german": Family(
        loop_files(
            {"time": "Zeit", "sp": "Sollwert", "pv": "Istwert", "op": "Stellwert", "auto": "Betriebsart"}
        )
    ),
    "xlsx": Family(xlsx(lambda d: wide(d, times=local(d)))),
    "xlsx-text-times": Family(xlsx(wide)),
    "xlsx-title": Family(xlsx(lambda d: wide(d, times=local(d)), rows_above=3)),
    "xlsx-second-sheet": Family(xlsx(lambda d: wide(d, times=local(d)), sheets=True)),
    "xlsx-units": Family(xlsx(lambda d: wide(d, times=local(d)), units=True)),
    "xlsx-serial": Family(xlsx(lambda d: wide(d, times=excel_serial(d)))),
    "xlsx-tall": Family(
        xlsx(
            lambda d: tall(d).assign(
                Timestamp=lambda r: (
                    pd.to_datetime(r["at"], utc=True).dt.tz_convert(ZONE).dt.tz_localize(None)
                ),
                Value=lambda r: (
                    pd.to_numeric(r["value"], errors="coerce")
                    .astype(object)
                    .where(r["role"] != "auto", r["value"])
                ),
            )[["Timestamp", "tag", "Value"]]
        )
    ),
    "lake": Family(
        parquet(
            lambda d: long(
                d, time="event_ts", loop="asset", sp="setpoint", pv="process_value", op="controller_output"
            ),
            index=False,
        )
    ),
    "lake-auto-word": Family(
        parquet(
            lambda d: long(d, time="ts", loop="equipment", sp="SP", pv="PV", op="CO").assign(
                mode=lambda t: modes(t.pop("auto"))
            ),
            index=False,
        )
    ),
    "parquet-index": Family(parquet(lambda d: wide(d, times=utc(d)).set_index("Timestamp"))),
    "parquet-unnamed-index": Family(
        parquet(lambda d: wide(d, times=utc(d)).set_index("Timestamp").rename_axis(None))
    ),
    "parquet-naive": Family(parquet(lambda d: wide(d, times=local(d)), index=False)),
    "parquet-strings": Family(parquet(lambda d: wide(d).astype(str), index=False)),
    "parquet-tall": Family(
        parquet(
            lambda d: tall(d).assign(timestamp=lambda r: pd.to_datetime(r["at"], utc=True))[
                ["timestamp", "tag", "value"]
            ],
            index=False,
        )
    ),
    "parquet-tall-numbers": Family(
        parquet(
            lambda d: tall(d, on="1", off="0").assign(
                timestamp=lambda r: pd.to_datetime(r["at"], utc=True),
                value=lambda r: r["value"].astype(float),
            )[["timestamp", "tag", "value"]],
            index=False,
        )
    ),
    "parquet-tall-category": Family(
        parquet(
            lambda d: tall(d).assign(
                timestamp=lambda r: pd.to_datetime(r["at"], utc=True),
                tag=lambda r: r["tag"].astype("category"),
            )[["timestamp", "tag", "value"]],
            index=False,
        )
    ),
}
