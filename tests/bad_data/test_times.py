"""Rows 12 to 28 and 64 of the bad-data matrix: samples that are missing, repeated, late, or of another clock."""

from __future__ import annotations

import logging
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from monitor.audit.run import run_audit
from monitor.audit.settings import AuditSettings
from monitor.contract.records import GOOD
from tests.bad_data.harness import (
    NAME,
    SECOND,
    SETTINGS,
    START,
    Live,
    audit,
    both,
    frame_of,
    good,
    live,
    messages,
    same,
    simulated,
    steps,
    write,
)

N = 700


def identical(found, clean) -> None:
    """To the last bit, as if nothing had happened."""
    same(found, clean, counts=False)
    assert found.counts["ok"] == clean.counts["ok"]


def later(data: pd.DataFrame, seconds: float) -> pd.DataFrame:
    return data.assign(time=data["time"] + round(seconds * SECOND))


# ---------------------------------------------------------------------------------------------------
# missing


def test_silence_of_one_loop_of_two(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    """Nothing of a loop for more than three periods (ten seconds at least): stale, in its row too, until it is back."""
    monitor = Live(tmp_path, [SETTINGS, {"name": "FIC-2"}])
    mine, other = messages(good(60, at=50)), messages(good(60, name="FIC-2", size=0.0))
    with caplog.at_level(logging.WARNING, "loopsight"):
        for k in range(40):
            monitor.put([*other[k], *(mine[k] if k < 20 else [])], 1.0)
        status = monitor.status()
        assert (status["loops"]["stale"], status["stale"], status["ready"]) == (1, [NAME], True)
        assert [r.loop for r in monitor.service.rows() if "stale" in r.flags] == [NAME]
        for k in range(40, 60):
            monitor.put([*other[k], *mine[k]], 1.0)
    assert monitor.status()["loops"]["stale"] == 0
    assert not [r for r in monitor.service.rows() if "stale" in r.flags]
    assert [r.getMessage() for r in caplog.records] == [f"stale: {NAME}", f"heard again: {NAME}"]
    monitor.close()


def test_silence_of_all_loops_is_one_event(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    """A thousand loops fall silent at once: one line, not a thousand; not ready; ready when they are back."""
    names = [f"L{k}" for k in range(1000)]
    monitor = Live(tmp_path, [{"name": n} for n in names])
    second = pd.DataFrame({"loop": names, "time": START * SECOND, "sp": 1.0, "pv": 1.0, "op": 1.0})
    with caplog.at_level(logging.WARNING, "loopsight"):
        for k in range(60):
            if not 20 <= k < 50:
                monitor.put([("plant/frame", frame_of(later(second, k)))], 1.0)
            else:
                monitor.wait(1.0)
            status = monitor.status()
            silent = 30 <= k < 50
            assert (status["ready"], status["not_ready"]) == (not silent, ["silent"] if silent else []), k
    assert [r.getMessage() for r in caplog.records] == [
        "no good samples of any loop: not ready",
        "samples are back",
    ]
    said = [k for k, _, _ in monitor.bus.said if k.endswith("/@/monitor/status")]
    assert len(said) <= 60 // 10 + 3
    monitor.close()


def test_a_loop_that_falls_silent_for_good(tmp_path: Path) -> None:
    """Its last sample long before that of the others: stale, live and in the audit, with the time of its last."""
    table = [{"name": "ENDS"}, {"name": "GOES-ON"}, {"name": "SLOW", "period": 3600.0}]
    calm = {"kp": 1.4, "ti": 600.0}
    ends = good(500, name="ENDS", size=0.0, period=10.0, **calm)
    on, slow = (
        good(n, name=m, size=0.0, period=p, kp=0.001, ti=1e6)
        for n, m, p in ((1200, "GOES-ON", 10.0), (4, "SLOW", 3600.0))
    )
    data = pd.concat([ends, on, slow]).sort_values("time", kind="stable", ignore_index=True)
    found = both(data, tmp_path, table=table, payloads=("frame",))
    assert {n for n, r in found.rows.items() if "stale" in r.flags} == {"ENDS"}
    assert found.rows["ENDS"].reason.startswith("no sample since Thursday 2026-01-01, 01:23 UTC; ")
    assert found.about["newest_sample"].startswith("2026-01-01T03:19:50")


@pytest.mark.parametrize(("hours", "n", "stale"), [(0.9, 500, False), (1.1, 500, True), (1.1, 45_000, False)])
def test_a_short_silence_at_the_end_of_a_file_is_none(
    tmp_path: Path, hours: float, n: int, stale: bool
) -> None:
    """An hour, or a hundredth of the whole time: a historian that writes what changes is as silent as that."""
    parts = [good(n, name=m, size=0.0, period=10.0, kp=1.4, ti=600.0) for m in ("ENDS", "GOES-ON")]
    parts[0] = parts[0][: -round(hours * 360)]
    data = pd.concat(parts).sort_values("time", kind="stable", ignore_index=True)
    table = [{"name": m} for m in ("ENDS", "GOES-ON")]
    found = audit(data, tmp_path, ".parquet", table)
    assert {m for m, r in found.rows.items() if "stale" in r.flags} == ({"ENDS"} if stale else set())


@pytest.mark.parametrize("period", [20.0, 60.0])
def test_a_slow_loop_is_not_stale_between_its_samples(tmp_path: Path, period: float) -> None:
    """Three of its own periods, not ten seconds."""
    monitor = Live(tmp_path, [{"name": NAME, "period": period}])
    for single in messages(good(20, at=15, period=period)):
        monitor.put(single)
        for _ in range(int(period)):
            monitor.wait(1.0)
            assert monitor.status()["loops"]["stale"] == 0
    monitor.wait(2.2 * period)
    monitor.wait(1.0)
    assert monitor.status()["loops"]["stale"] == 1
    monitor.close()


@pytest.mark.parametrize("at", [100, 306])
def test_one_sample_is_missing(clean, tmp_path: Path, at: int) -> None:
    """Bridged: the interval is twice as long in integrals and averages; no event of its own."""
    found = both(good(N).drop(index=at), tmp_path)
    found.counted(ok=N - 1)
    assert (found.event.id, found.states) == (clean.event.id, ["settled"])
    assert found.event.iae == pytest.approx(clean.event.iae, rel=0.01)
    assert found.row.verdict == GOOD


def test_a_twentieth_of_the_samples_is_missing(clean, tmp_path: Path) -> None:
    """At random: IAE within 1 %, no other event, coverage falls by about as much."""
    rng = np.random.default_rng(3)
    lost = rng.choice(np.setdiff1d(np.arange(1, N), [299, 300, 301]), N // 20, replace=False)
    found = both(good(N).drop(index=lost), tmp_path)
    assert (found.event.id, found.states) == (clean.event.id, ["settled"])
    assert found.event.iae == pytest.approx(clean.event.iae, rel=0.01)
    assert found.row.gain == pytest.approx(clean.row.gain, rel=0.02)
    assert 0.93 < found.row.coverage < 0.99


def test_an_hour_is_missing_during_a_step(tmp_path: Path) -> None:
    """The event ends before the gap, by it, without a suggestion; nothing is integrated across; a new start after."""
    data = good(N)
    data = pd.concat([data[:310], later(data[310:], 3600)], ignore_index=True)
    found = both(data, tmp_path)
    first = found.events[0]
    assert (first.state, first.end) == ("interrupted", int(data["time"][309]))
    assert "gap" in first.reason
    assert first.iae < 100
    assert found.row.new_kp is None
    assert found.row.coverage < 0.2


def test_an_hour_is_missing_at_rest(clean, tmp_path: Path) -> None:
    """Before the step: the same event, an hour later, of the same size; the hour is not covered."""
    data = good(N)
    data = pd.concat([data[:150], later(data[150:], 3600)], ignore_index=True)
    found = both(data, tmp_path)
    assert (found.states, found.row.verdict) == (["settled"], GOOD)
    assert found.event.start == clean.event.start + 3600 * SECOND
    assert found.event.iae == pytest.approx(clean.event.iae, rel=0.05)  # its noise was learnt anew


# ---------------------------------------------------------------------------------------------------
# repeated, out of order


def test_repeated_samples_change_nothing(clean, tmp_path: Path) -> None:
    """The same sample again, at once or a second later: dropped and counted; the records are those without."""
    data = good(N)
    again = pd.concat([data, data[100:150], data[305:306], data[305:306]])
    again = again.sort_values("time", kind="stable", ignore_index=True)
    found = both(again, tmp_path, payloads=("sample", "tag", "frame"))
    found.counted(ok=N, duplicate=52)
    identical(found, clean)
    data["arrival"] = data["time"]
    straggling = pd.concat([data, data[100:150].assign(arrival=data["time"] + SECOND)])
    straggling = straggling.sort_values("arrival", kind="stable", ignore_index=True)
    identical(live(straggling, tmp_path / "straggling"), clean)


def test_other_values_at_the_same_time_are_a_conflict(clean, tmp_path: Path) -> None:
    """The first is kept, good or bad, live and in the audit; the others are counted, and it is the same each time."""
    data = good(N)
    other = data[100:110].assign(pv=99.0)
    found = both(
        pd.concat([data, other]).sort_values("time", kind="stable", ignore_index=True),
        tmp_path,
        payloads=("sample", "tag", "frame"),
    )
    found.counted(ok=N, duplicate=10, conflict=10)
    identical(found, clean)
    spoilt = data.copy()
    spoilt.loc[100, "pv"] = np.nan
    first_bad = pd.concat([spoilt, data[100:101]]).sort_values("time", kind="stable", ignore_index=True)
    both(first_bad, tmp_path / "b").counted(ok=N - 1, bad_value=1, duplicate=1, conflict=1)


def test_out_of_order_within_the_window_is_sorted(clean, tmp_path: Path) -> None:
    """Up to two seconds late, in any order: live and audit give what the sorted samples give, to the last bit."""
    data = good(N)
    data["arrival"] = data["time"] + np.random.default_rng(5).integers(0, int(1.9 * SECOND), N)
    data = data.sort_values("arrival", kind="stable", ignore_index=True)
    assert (np.diff(data["time"]) < 0).sum() > 50
    for payload in ("sample", "tag", "frame"):
        found = live(data, tmp_path / payload, payload, every=1.0)
        found.counted(ok=N)
        identical(found, clean)
    identical(audit(data, tmp_path / "a"), clean)


def test_a_backfill_is_late_and_turns_nothing_back(clean, tmp_path: Path) -> None:
    """An old batch that a gateway sends again: live it is late, all of it; in the audit it is repeated."""
    data = good(N)
    data["arrival"] = data["time"]
    batch = data[50:150].assign(arrival=int(data["time"][400]) + 1)
    together = pd.concat([data, batch]).sort_values("arrival", kind="stable", ignore_index=True)
    found = live(together, tmp_path / "live")
    found.counted(ok=N, late=100)
    identical(found, clean)
    filed = audit(together, tmp_path / "audit")
    filed.counted(ok=N, duplicate=100)
    identical(filed, clean)


def test_what_comes_after_the_window_serves_the_audit_only(clean, tmp_path: Path) -> None:
    """Ten samples that come ten seconds late: live they are late and a gap, in the audit they are in their place."""
    data = good(N)
    data["arrival"] = data["time"]
    data.loc[150:151, "arrival"] += 10 * SECOND
    data = data.sort_values("arrival", kind="stable", ignore_index=True)
    found = live(data, tmp_path / "live")
    found.counted(ok=N - 2, late=2)
    assert found.states == ["settled"]
    identical(audit(data, tmp_path / "audit"), clean)


def test_files_in_reverse_or_overlapping(clean, tmp_path: Path) -> None:
    """The newest first, or two files that share an hour: what sorted unique rows give."""
    data = good(N)
    for suffix in (".csv", ".parquet"):
        identical(audit(data[::-1], tmp_path / "reverse", suffix), clean)
        folder = tmp_path / suffix
        folder.mkdir()
        parts = [write(data[:400], folder / f"a{suffix}"), write(data[250:], folder / f"b{suffix}")]
        found = audit(parts[::-1], tmp_path / f"two{suffix}")
        found.counted(ok=N, duplicate=150)
        identical(found, clean)


# ---------------------------------------------------------------------------------------------------
# clocks


def test_a_clock_that_jumps_ahead(clean, tmp_path: Path) -> None:
    """Samples an hour in the future are refused, and their source is named, until its clock is right again."""
    data = good(N)
    monitor = Live(tmp_path / "m")
    for k, single in enumerate(messages(data)):
        if 100 <= k < 150:
            single = messages(later(data[k : k + 1], 3600))[0]  # noqa: PLW2901 (the same sample by another clock)
        monitor.put(single, 1.0)
        assert monitor.status()["clock_ahead"] == ([NAME] if 100 <= k < 150 else [])
    found = monitor.outcome()
    monitor.close()
    assert (found.counts["ok"], found.about["future"], found.counts["late"]) == (N - 50, 50, 0)
    assert (found.states, found.row.verdict) == (["settled"], GOOD)
    assert found.event.iae == pytest.approx(clean.event.iae, rel=0.05)
    same(audit(data.drop(index=range(100, 150)), tmp_path / "a"), found)


def test_a_clock_that_is_up_to_a_minute_ahead_is_believed(tmp_path: Path) -> None:
    """Half a minute is no fault."""
    data = good(N)
    found = live(later(data, 30).assign(arrival=data["time"]), tmp_path)
    assert found.about["future"] == 0
    assert (found.states, found.row.verdict) == (["settled"], GOOD)


def test_a_clock_that_is_set_back_an_hour(clean, tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    """Late for half a minute, then the loop begins anew at the earlier time: no hour is dropped, no event spans it."""
    data = good(1100, at=500)
    data["arrival"] = data["time"]
    data.loc[200:, "time"] -= 3600 * SECOND
    with caplog.at_level(logging.WARNING, "loopsight"):
        found = live(data, tmp_path, every=1.0)
    assert found.counts["late"] == 30
    assert found.counts["ok"] == 1100 - 30
    assert found.about["clock_steps"] == 1
    assert (found.states, found.row.verdict) == (["settled"], GOOD)
    assert found.event.start == int(data["time"][500])
    assert found.event.iae == pytest.approx(clean.event.iae, rel=0.05)
    (line,) = [r.getMessage() for r in caplog.records if "clock" in r.getMessage()]
    assert line.startswith(f"{NAME}: its clock was set back to 2025-12-31T23:03:20")
    assert 0.95 < found.row.coverage < 0.98


def test_a_clock_set_back_during_a_step_ends_its_event(tmp_path: Path) -> None:
    """What was open ends where the clock was right; the rest of the response is no event of its own."""
    data = good(700)
    data["arrival"] = data["time"]
    data.loc[310:, "time"] -= 3600 * SECOND
    found = live(data, tmp_path, every=1.0)
    assert found.states == ["interrupted"]
    assert found.event.end == int(data["time"][309])
    assert found.about["clock_steps"] == 1


def test_a_file_whose_clock_was_set_back(tmp_path: Path) -> None:
    """The same in a file: rows of one hour twice, sorted, repeated times counted; each row has one cause."""
    data = good(8000, at=6000)
    data.loc[4000:, "time"] -= 3600 * SECOND
    found = audit(data, tmp_path)
    found.counted(ok=4400, duplicate=3600, conflict=3600)


def test_the_monitors_own_clock_does_not_matter_for_what_waits(clean, tmp_path: Path) -> None:
    """The wall clock of the monitor is set an hour back and ahead: nothing trips, nothing is lost, nobody is stale."""
    monitor = Live(tmp_path)
    for k, single in enumerate(messages(good(N))):
        if k in {200, 400}:
            monitor.now += (-1 if k == 200 else 1) * 50 * SECOND
        monitor.put(single, 1.0)
        status = monitor.status()
        assert (status["ready"], status["loops"]["stale"]) == (True, 0)
    found = monitor.outcome()
    monitor.close()
    found.counted(ok=N)
    identical(found, clean)


# ---------------------------------------------------------------------------------------------------
# how time is written


def local(data: pd.DataFrame, zone: str) -> pd.DataFrame:
    """Times as a historian's export of local time has them."""
    times = pd.to_datetime(data["time"], utc=True).dt.tz_convert(zone)
    return data.assign(time=times.dt.strftime("%Y-%m-%d %H:%M:%S"))


@pytest.mark.parametrize(
    ("change", "what"), [("2026-10-25T01:00:00", "repeats"), ("2026-03-29T01:00:00", "skips")]
)
def test_local_times_across_a_change_of_the_clocks(tmp_path: Path, change: str, what: str) -> None:
    """An hour that is there twice, or not at all, in local time: with its zone named, what UTC gives, live too."""
    data = good(900, at=600, period=10.0)
    data["time"] += int(np.datetime64(change, "ns").astype(np.int64)) - START * SECOND - 4500 * SECOND
    table = [{**SETTINGS, "kp": 1.4, "ti": 600.0}]
    data = data.assign(**good(900, at=600, period=10.0, kp=1.4, ti=600.0)[["pv", "op"]])
    found = both(data, tmp_path, table=table)
    assert found.states
    written = local(data, "Europe/Berlin")
    assert written["time"].duplicated().any() == (what == "repeats")
    in_zone = audit(written, tmp_path / "zone", table=table, tz="Europe/Berlin")
    same(in_zone, found)
    assert in_zone.about["time_zone"] == "Europe/Berlin"
    assert in_zone.about["times_without_zone"] == ["data.csv"]


def test_a_local_time_that_does_not_exist_names_its_line(tmp_path: Path) -> None:
    """02:30 in the night of the change in spring: the file and the line are named, nothing is guessed."""
    data = local(good(10), "Europe/Berlin")
    data.loc[4:, "time"] = "2026-03-29 02:30:00"
    write(data, tmp_path / "d.csv")
    result = run_audit([tmp_path / "d.csv"], None, tmp_path / "out", AuditSettings(tz="Europe/Berlin"))
    assert result.exit_code == 2
    assert result.problems[0].startswith("d.csv:6: time: 2026-03-29 02:30:00 does not exist")


@pytest.mark.parametrize("unit", ["s", "ms", "us", "ns", "excel"])
@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
def test_numeric_times_of_any_unit(clean, tmp_path: Path, unit: str, suffix: str) -> None:
    """Told by their range: the records are those of the same instants as text."""
    data = good(N)
    scale = {"s": 1e9, "ms": 1e6, "us": 1e3, "ns": 1}
    time = data["time"] / 86_400e9 + 25_569 if unit == "excel" else data["time"] // int(scale[unit])
    identical(audit(data.assign(time=time.to_numpy().astype(object)), tmp_path, suffix), clean)


@pytest.mark.parametrize(
    ("times", "says"),
    [([1.77e9, 1.77e12], "mixed, expected one unit"), ([45_000.0, 45_000.5], "--time-unit")],
)
def test_times_of_an_unclear_unit_are_refused(tmp_path: Path, times: list[float], says: str) -> None:
    """Seconds and milliseconds in one file, or numbers that may be days or seconds: an error that names the option."""
    data = good(10)
    data["time"] = np.resize(times, 10)
    data.to_csv(tmp_path / "d.csv", index=False)
    result = run_audit([tmp_path / "d.csv"], None, tmp_path / "out")
    assert result.exit_code == 2
    assert says in result.problems[0]


@pytest.mark.parametrize("nothing", [0, "1970-01-01T00:00:00Z", "1900-01-01T00:00:00Z"])
def test_a_gateways_zero_is_no_time(clean, tmp_path: Path, nothing: object) -> None:
    """1970 or 1900 among times of today: that row has no time, the others count."""
    data = good(N)
    rows = messages(data)
    extra = f'{{"t": {nothing if nothing == 0 else repr(nothing)}, "sp": 50, "pv": 50, "op": 40}}'
    monitor = Live(tmp_path / "m")
    for k, single in enumerate(rows):
        strange = [("plant/LIC-101", extra.replace("'", '"').encode())] if k == 100 else []
        monitor.put([*single, *strange], 1.0)
    found = monitor.outcome()
    monitor.close()
    found.counted(ok=N, bad_time=1)
    identical(found, clean)
    iso = np.datetime_as_string(data["time"].to_numpy().astype("M8[ns]"))
    times = [f"{t}Z" for t in iso] if nothing else (data["time"] // SECOND).astype(object)
    filed = data.assign(time=times)
    filed = pd.concat([filed[:100], filed[100:101].assign(time=nothing), filed[100:]], ignore_index=True)
    same(audit(filed, tmp_path / "a"), found)


def test_a_time_without_zone_is_utc_and_it_is_said(clean, tmp_path: Path) -> None:
    """In the audit unless a zone is named, live always."""
    data = good(N)
    naive = np.datetime_as_string(data["time"].to_numpy().astype("M8[ns]"), unit="s")
    found = audit(data.assign(time=naive), tmp_path / "a")
    identical(found, clean)
    assert (found.about["time_zone"], found.about["times_without_zone"]) == ("UTC", ["data.csv"])
    written = data.assign(time=naive, arrival=data["time"])
    identical(live(written, tmp_path / "l"), clean)


# ---------------------------------------------------------------------------------------------------
# periods


def test_jittered_times(clean, tmp_path: Path) -> None:
    """Periods of 0.8 to 1.2 s: the same verdict, gain and index as with even ones."""
    jitter = np.random.default_rng(2).integers(-100, 100, N) * 1_000_000
    data = good(N)
    data["time"] += jitter
    found = both(data, tmp_path)
    found.counted(ok=N)
    assert (found.states, found.row.verdict) == (["settled"], GOOD)
    assert found.row.gain == pytest.approx(clean.row.gain, rel=0.05)
    assert found.event.ci == pytest.approx(clean.event.ci, rel=0.1)


def test_every_loop_has_its_own_period(tmp_path: Path) -> None:
    """Loops of 0.1 to 60 s beside each other: each is judged as if it were alone."""
    periods = {"fast": 0.1, "usual": 1.0, "slow": 60.0}
    parts, table = [], []
    for name, period in periods.items():
        part = good(N, name=name, period=period, kp=14.0 / period, ti=20.0 * period)
        parts.append(later(part, (N - 1) * (60.0 - period)))  # all end together
        table.append({"name": name, "kp": 14.0 / period, "ti": 20.0 * period})
    data = pd.concat(parts).sort_values("time", kind="stable", ignore_index=True)
    found = both(data, tmp_path, table=table, payloads=("frame",), every=600.0)
    assert [e.state for e in found.events] == ["settled"] * 3
    assert {r.verdict for r in found.rows.values()} == {GOOD}
    for name, row in found.rows.items():
        assert row.gain == pytest.approx(0.01, rel=0.1), name
    ci = [e.ci for e in found.events]
    assert max(ci) == pytest.approx(min(ci), rel=0.1)


def test_a_period_that_changes_in_mid_stream(tmp_path: Path) -> None:
    """A gateway goes over from 1 s to 5 s at rest: followed, no event of its own, the next step is judged."""
    data = simulated(steps(2500, (2000, 5.0)))
    data = data[(data.index < 800) | (data.index % 5 == 0)].reset_index(drop=True)
    found = both(data, tmp_path)
    assert found.states == ["settled"]
    assert found.event.start == (START + 2000) * SECOND
    assert found.row.new_kp is None  # at 5 s the response is over in a few samples


# ---------------------------------------------------------------------------------------------------
# years


@pytest.mark.parametrize("year", [1995, 2038, 2100])
def test_other_years(clean, tmp_path: Path, year: int) -> None:
    """Before 2000 and after 2038: the same event, at its time, to the nanosecond."""
    shift = int(np.datetime64(f"{year}-02-01", "ns").astype(np.int64)) - START * SECOND
    found = both(good(N).assign(time=lambda d: d["time"] + shift), tmp_path)
    assert found.event.start == clean.event.start + shift
    assert (found.event.iae, found.event.ci) == (clean.event.iae, clean.event.ci)


def test_a_leap_second_is_refused_with_its_cause(clean, tmp_path: Path) -> None:
    """23:59:60 is no time in either way in: that row is counted, the others are used."""
    data = good(N)
    leap = b'{"t": "2026-06-30T23:59:60Z", "sp": 50, "pv": 50, "op": 40}'
    monitor = Live(tmp_path / "m")
    for k, single in enumerate(messages(data)):
        monitor.put([*single, *([("plant/LIC-101", leap)] if k == 100 else [])], 1.0)
    found = monitor.outcome()
    monitor.close()
    assert (found.counts["ok"], found.about["malformed"] + found.about["bad_time"]) == (N, 1)
    identical(found, clean)
    iso = np.datetime_as_string(data["time"].to_numpy().astype("M8[ns]"))
    filed = data.assign(time=[f"{t}Z" for t in iso])
    filed = pd.concat([filed, filed[:1].assign(time="2026-06-30T23:59:60Z")], ignore_index=True)
    rejected = audit(filed, tmp_path / "a")
    rejected.counted(ok=N, bad_time=1)
    assert rejected.about["times_unreadable"] == ["2026-06-30T23:59:60Z"]
    identical(rejected, clean)
