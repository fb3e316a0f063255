"""What an audit says of itself: ``audit.json``, what was left out, and why nothing was found. Facts in, facts out."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from typing import Any

from monitor.adapters.historian.reading import reading_of, same_readings, unused_of
from monitor.adapters.historian.rows import Tally
from monitor.adapters.historian.source import Source
from monitor.contract.records import WORST_FIRST, LoopRow
from monitor.contract.text import visible
from monitor.contract.times import iso

from .inputs import Inputs, identity
from .settings import AuditSettings

AUDIT_SCHEMA = 1
MOST_LISTED_TEXTS = 20
"""Different texts in place of values that ``audit.json`` lists, the most frequent."""
MOST_SHOWN_LINES = 5
"""Lines per file that are named on the terminal; all kept ones are in ``audit.json``."""


def counted(tally: Tally, samples: Mapping[str, int], events: int, rows: Sequence[LoopRow]) -> dict[str, int]:
    """Return what was read, used, refused and found."""
    verdicts = Counter(r.verdict for r in rows)
    return {
        "rows": tally.rows,
        **{name: samples[name] for name in ("ok", "uncertain", "bad_value", "bad_quality")},
        "bad_time": tally.bad_time,
        "duplicate": tally.duplicate + samples["duplicate"],
        "conflict": tally.conflict + samples["conflict"],
        "late": samples["late"],
        "outside": tally.outside,
        "lost_lines": sum(tally.lost_lines.values()),
        "events": events,
        "loops": len(rows),
        **{f"loops_{verdict}": verdicts[verdict] for verdict in WORST_FIRST},
    }


def loops_left_out(inputs: Inputs, tally: Tally) -> dict[str, str]:
    """Return the loops that were left out, and why."""
    left = dict(inputs.loops_left)
    for source in inputs.sources:
        for name, reason in source.layout.incomplete.items():
            if name not in tally.loop_rows:
                left[name] = f"{source.name}: {reason}"
    for name in tally.unknown:
        if name not in inputs.loops.by_name:
            left.setdefault(name, "not in the loop table")
    return left


def problems(inputs: Inputs, tally: Tally, left: Mapping[str, str]) -> list[str]:
    """Say what was left out, one line each: files, lines, loops."""
    out = [*inputs.problems, *map(str, inputs.files_left)]
    for file in sorted(tally.lost_lines):
        lines = sorted(tally.lines.get(file, {}).items())
        out += [f"{file}:{n}: {reason}" for n, reason in lines[:MOST_SHOWN_LINES]]
        more = tally.lost_lines[file] - len(lines[:MOST_SHOWN_LINES])
        if more > 0:
            out.append(f"{file}: {more} more lines that cannot be read")
    out += _repeated(inputs, tally)
    return out + [f"loop {visible(name, 80)}: {reason}" for name, reason in sorted(left.items())]


def notes_on_reading(inputs: Inputs) -> list[str]:
    """Say how recognised files are read, and which columns are not used: one line each, files of a kind together."""
    lines = [*inputs.columns_unknown, *same_readings(inputs.sources)]
    for source in inputs.sources:
        unused = unused_of(source.layout)
        if unused:
            lines.append(f"{source.name}: {unused}")
    return lines


def _repeated(inputs: Inputs, tally: Tally) -> list[str]:
    """Say that times came again with other values: two samples cannot be of one time, so a clock went back."""
    if not tally.conflict:
        return []
    said = (
        f"times repeat or go back: {tally.conflict} rows with other values at a time that their loop has had are "
        "left out"
    )
    naive = any(s.clock.naive for s in inputs.sources)
    return [
        f"{said}; local times of a night when clocks went back? Name their zone by --tz" if naive else said
    ]


def why_nothing(inputs: Inputs, tally: Tally, samples: Mapping[str, int]) -> str:
    """Say why no loop was audited, though there were files."""
    if tally.rows:
        bad = {**{n: samples[n] for n in ("bad_value", "bad_quality")}, "bad_time": tally.bad_time}
        bad["outside --since/--until"] = tally.outside
        causes = ", ".join(f"{n} {name}" for name, n in bad.items() if n)
        return f"no good sample in {tally.rows} rows: {causes}"
    have = ", ".join(visible(loop.name, 80) for loop in list(inputs.loops)[:5])
    return f"no loop of the table is in the data; the table has {have or 'none'}, ..."


def about(
    inputs: Inputs,
    settings: AuditSettings,
    tally: Tally,
    *,
    counts: Mapping[str, int],
    left: Mapping[str, str],
    reach: tuple[int, int],
    identities: Mapping[str, Mapping[str, Any]],
) -> dict[str, Any]:
    """Return ``audit.json``: what was read, how, and what could not be used.

    Parameters
    ----------
    counts, left
        As `counted` and `loops_left_out` say.
    reach
        Times of the first and the newest sample of all loops [ns since 1970].
    identities
        Name, size and hash of each input.
    """
    span = settings.span()
    table = inputs.loops_file
    return {
        "schema": AUDIT_SCHEMA,
        "versions": {"loopsight": package_version()},
        "generated_at": datetime.now(UTC).isoformat(timespec="seconds").replace("+00:00", "Z"),
        "settings": {
            "loops": None if table is None else identity(table, table.name),
            "since": _iso(span.since),
            "until": _iso(span.until),
            "time_unit": settings.time_unit,
        },
        "time_zone": settings.tz or "UTC",
        "times_without_zone": sorted(s.name for s in inputs.sources if s.clock.naive),
        "inputs": [{**identities[s.name], **_read_as(s, tally)} for s in inputs.sources],
        "counts": counts,
        "first_sample": _iso(reach[0]),
        "newest_sample": _iso(reach[1]),
        "text_in_values": {"count": tally.bad_texts, "most_frequent": _most_frequent(tally.texts)},
        "quality_not_good": _most_frequent(tally.qualities),
        "times_unreadable": sorted(tally.times)[:MOST_LISTED_TEXTS],
        "held_where_empty": {s.name: sorted(s.sparse) for s in inputs.sources if s.sparse},
        "columns_not_used": {s.name: list(s.layout.unused) for s in inputs.sources if s.layout.unused},
        "quality_unknown": sorted(s.name for s in inputs.sources if not _has_quality(s)),
        "loops_without_data": sorted(n for n in inputs.loops.by_name if n not in tally.loop_rows),
        "skipped": {
            "files": [
                {"name": e.name, "line": e.line, "reason": e.reason}
                for e in sorted(inputs.files_left, key=lambda e: e.name)
            ],
            "lines": [
                {"name": file, "line": n, "reason": reason}
                for file in sorted(tally.lines)
                for n, reason in sorted(tally.lines[file].items())
            ],
            "loops": [{"loop": name, "reason": reason} for name, reason in sorted(left.items())],
        },
    }


def _read_as(source: Source, tally: Tally) -> dict[str, Any]:
    clock = source.clock
    order = f" [{clock.order}]" if clock.order else ""
    return {
        "layout": source.layout.kind,
        "rows": source.rows if source.rows is not None else tally.file_rows.get(source.name, 0),
        **({"read_as": reading_of(source)} if source.recognised else {}),
        "time": f"{clock.kind} [{clock.unit}]" if clock.kind == "number" else clock.kind + order,
    }


def _most_frequent(counts: Mapping[str, int]) -> dict[str, int]:
    return dict(sorted(counts.items(), key=lambda item: (-item[1], item[0]))[:MOST_LISTED_TEXTS])


def _has_quality(source: Source) -> bool:
    return bool(source.layout.quality) or all("quality" in roles for roles in source.layout.columns.values())


def _iso(time: int | None) -> str | None:
    return None if time is None else iso(time, "ns")


def package_version() -> str:
    """Return the version of the distribution, ``0`` where it is not installed."""
    try:
        return version("loopsight")
    except PackageNotFoundError:
        return "0"
