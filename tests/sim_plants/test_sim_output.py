"""Where samples go: payloads, pacing, historian export."""

import io
import json
import threading

import numpy as np
import pandas as pd
import pyarrow as pa
import pytest

from monitor.contract.entries import Message
from monitor.contract.loop_fields import parse_row
from monitor.contract.loops import Loop, LoopTable
from monitor.wire.decode import Decoder
from sim_plants.controllers import Controller
from sim_plants.export import write_export
from sim_plants.fleet import random_fleet
from sim_plants.loops import Block, LoopSpec, Simulation
from sim_plants.payloads import encode_frame, encode_sample, encode_tag, iso_times, name_array
from sim_plants.plants import Plant
from sim_plants.publish import Publisher, run, start_time

LOOP = LoopSpec("LIC-101", Plant("integrating", 0.1, 2.0), Controller(1.0, 20.0), noise=0.1)
LOOPS = [LOOP, LoopSpec("area 1/FIC#2", LOOP.plant, LOOP.controller, period=0.5, auto=False)]
NOON = 1_795_341_600.0  # 2026-11-22T10:00:00Z


def strict(payload):
    """JSON without NaN and infinity."""

    def refuse(text):
        raise AssertionError(text)

    return json.loads(payload, parse_constant=refuse)


def published(payload, seconds=2.0, loops=LOOPS):
    messages = []
    simulation = Simulation(loops, NOON)
    block = simulation.advance(seconds)
    publisher = Publisher(lambda key, data: messages.append((key, data)), loops, payload)
    publisher.publish(block)
    assert publisher.messages == len(messages)
    return block, messages


def test_time_on_the_wire():
    assert iso_times(np.array([1_795_341_600_250_000_000])) == ["2026-11-22T10:00:00.250000Z"]


def test_tags():
    block, messages = published("tag")
    assert len(messages) == 4 * len(block)
    assert [key for key, _ in messages[:8]] == [
        *(f"plant/LIC-101/{name}" for name in ("sp", "op", "auto", "pv")),
        *(f"plant/area 1%2FFIC%232/{name}" for name in ("sp", "op", "auto", "pv")),
    ]
    pv = strict(messages[3][1])
    assert pv == {"v": block.pv[0], "t": "2026-11-22T10:00:00.000000Z"}
    assert [strict(messages[i][1])["v"] for i in (2, 6)] == [1.0, 0.0]
    assert strict(messages[11][1])["t"] == "2026-11-22T10:00:00.500000Z"


def test_samples():
    block, messages = published("sample")
    assert len(messages) == len(block)
    for i, (key, payload) in enumerate(messages):
        row = strict(payload)
        assert list(row) == ["t", "sp", "pv", "op", "auto"]
        assert key == ("plant/LIC-101", "plant/area 1%2FFIC%232")[block.loop[i]]
        assert (row["sp"], row["pv"], row["op"]) == (block.sp[i], block.pv[i], block.op[i])
        assert row["auto"] is bool(block.auto[i])
        assert pd.Timestamp(row["t"]).value == block.time_ns[i]


@pytest.mark.parametrize("payload", ["tag", "sample", "frame"])
def test_the_monitor_reads_every_payload_without_a_loss(payload):
    block, messages = published(payload, 30.0)
    table = LoopTable([Loop(name=loop.name) for loop in LOOPS])
    decoder = Decoder(table)
    entries = decoder.decode([Message(key, data, 0) for key, data in messages], 2**62)
    assert not decoder.causes
    if payload == "tag":
        sp, op, auto, pv = (entries[i::4] for i in range(4))
        read = {"loop": pv["loop"], "time": pv["time"], "sp": sp["sp"], "pv": pv["pv"], "op": op["op"]}
        read["auto"] = auto["auto"]
    else:
        read = {name: entries[name] for name in ("loop", "time", "sp", "pv", "op", "auto")}
    for name, values in read.items():
        np.testing.assert_array_equal(values, getattr(block, "time_ns" if name == "time" else name))


def test_a_missing_value_is_left_out():
    stamp = "2026-11-22T10:00:00Z"
    assert encode_tag(np.nan, stamp) is None
    assert strict(encode_sample(stamp, np.nan, 1.0, np.inf, True)) == {"t": stamp, "pv": 1.0, "auto": True}


def frames(messages):
    return [(key, pa.ipc.open_stream(io.BytesIO(payload)).read_all()) for key, payload in messages]


def test_frames():
    block, messages = published("frame", 900.0)
    decoded = frames(messages)
    assert {key for key, _ in decoded} == {"plant/area1/frame"}
    assert [int(table.schema.metadata[b"seq"]) for _, table in decoded] == [0, 1, 2]
    assert max(len(table) for _, table in decoded) == 1000
    table = pa.concat_tables([table.replace_schema_metadata() for _, table in decoded])
    assert table.column_names == ["loop", "time", "sp", "pv", "op", "auto"]
    names = np.array([loop.name for loop in LOOPS])[block.loop]
    assert table["loop"].to_pylist() == names.tolist()
    np.testing.assert_array_equal(table["time"].cast(pa.int64()).to_numpy(), block.time_ns)
    for name in ("sp", "pv", "op", "auto"):
        np.testing.assert_array_equal(table[name].to_numpy(zero_copy_only=False), getattr(block, name))


def test_frames_of_a_large_plant_go_by_area_each_counted_by_itself():
    loops = [LoopSpec(f"L{i}", LOOP.plant, LOOP.controller) for i in range(2300)]
    _, messages = published("frame", 2.0, loops)
    decoded = frames(messages)
    for area, count in ((1, 1000), (2, 1000), (3, 300)):
        mine = [table for key, table in decoded if key == f"plant/area{area}/frame"]
        assert [int(table.schema.metadata[b"seq"]) for table in mine] == list(range(len(mine)))
        assert sum(len(table) for table in mine) == 2 * count


def test_a_frame_names_only_the_loops_it_holds():
    block = Simulation(LOOPS).advance(1.0)
    one = Block(*(getattr(block, n)[1:] for n in ("loop", "time_ns", "sp", "pv", "op", "auto")))
    table = frames([("k", encode_frame(name_array([loop.name for loop in LOOPS]), one, 7))])[0][1]
    assert table["loop"].chunk(0).dictionary.to_pylist() == ["area 1/FIC#2"]


def test_an_unknown_payload_is_refused():
    with pytest.raises(ValueError, match="payload: 'csv', expected one of tag, sample, frame"):
        Publisher(print, LOOPS, "csv")


class Clock:
    """Time that passes only while one waits, and `cost` with each look."""

    def __init__(self, cost=0.0):
        self.passed, self.cost, self.waits = 0.0, cost, 0

    def monotonic(self):
        self.passed += self.cost
        return self.passed

    def now(self):
        return NOON + self.passed

    def wait(self, seconds):
        self.waits += 1
        self.passed += seconds


class Recorder:
    """Publisher that keeps blocks and when they came."""

    def __init__(self, clock, cost=0.0):
        self.clock, self.cost, self.blocks, self.at = clock, cost, [], []

    def publish(self, block):
        self.clock.passed += self.cost
        self.blocks.append(block)
        self.at.append(self.clock.now())

    @property
    def times(self):
        return np.concatenate([block.time_ns for block in self.blocks]) * 1e-9


def paced(speed, seconds, start=NOON, cost=0.0):
    clock = Clock()
    recorder = Recorder(clock, cost)
    simulation = Simulation([LOOP], start)
    run(
        simulation,
        recorder,
        speed,
        seconds,
        threading.Event(),
        monotonic=clock.monotonic,
        now=clock.now,
        wait=clock.wait,
    )
    return clock, recorder


def test_real_time_keeps_step_with_the_clock():
    clock, recorder = paced(1.0, 60.0)
    assert clock.passed == pytest.approx(60.0, abs=0.2)
    np.testing.assert_allclose(recorder.times, NOON + np.arange(60), atol=1e-6)
    for block, at in zip(recorder.blocks, recorder.at, strict=True):
        late = at - block.time_ns * 1e-9
        assert (late > 0).all()
        assert (late < 0.25).all()


def test_sixty_times_real_time_ends_at_the_present():
    clock, recorder = paced(60.0, 30.0, start_time(NOON, 60.0, 30.0))
    assert len(recorder.times) == pytest.approx(1800, abs=7)
    assert recorder.times[-1] <= clock.now()
    assert recorder.times[-1] > clock.now() - 8
    for block, at in zip(recorder.blocks, recorder.at, strict=True):
        assert (block.time_ns * 1e-9 <= at).all()


def test_faster_than_real_time_never_overtakes_the_clock():
    """Started too late in the past, it catches up and goes on in real time."""
    clock, recorder = paced(100.0, 20.0, NOON - 500.0)
    assert recorder.times[-1] <= clock.now()
    np.testing.assert_allclose(np.diff(recorder.times), 1.0, atol=1e-6)
    assert len(recorder.times) == pytest.approx(520, abs=2)


def test_a_slow_bus_is_made_up_for_without_a_gap():
    _, recorder = paced(10.0, 30.0, start_time(NOON, 10.0, 30.0), cost=3.0)
    np.testing.assert_allclose(np.diff(recorder.times), 1.0, atol=1e-6)
    assert len(recorder.times) == pytest.approx(300, abs=2)


def test_it_waits_instead_of_spinning():
    clock, recorder = paced(1.0, 60.0)
    assert clock.waits <= 610
    assert len(recorder.blocks) <= 610


def test_a_large_backlog_comes_in_pieces_and_a_stop_is_heard():
    stop, blocks = threading.Event(), []
    clock = Clock()

    class Stopper(Recorder):
        def publish(self, block):
            blocks.append(block)
            if len(blocks) == 3:
                stop.set()

    run(
        Simulation([LOOP], NOON - 1e7),
        Stopper(clock),
        1e6,
        None,
        stop,
        monotonic=lambda: clock.monotonic() + 10 * len(blocks),
        now=clock.now,
        wait=clock.wait,
    )
    assert len(blocks) == 3
    assert max(len(block) for block in blocks) == 200_000


@pytest.mark.parametrize("speed", [0.0, -1.0, np.nan, np.inf])
def test_a_bad_speed_is_refused(speed):
    with pytest.raises(ValueError, match="speed"):
        paced(speed, 1.0)


# ---------------------------------------------------------------------------------------------------
# historian export


def test_export_holds_the_samples_the_table_and_the_truth(tmp_path):
    loops = random_fleet(8, 5)
    n = write_export(loops, 5000.0, tmp_path / "new" / "dir", NOON)
    folder = tmp_path / "new" / "dir"
    data = pd.read_parquet(folder / "data.parquet")
    block = Simulation(loops, NOON).advance(5000.0)
    assert n == len(data) == len(block)
    assert list(data.columns) == ["loop", "time", "sp", "pv", "op", "auto"]
    assert str(data["time"].dtype) == "datetime64[ns, UTC]"
    np.testing.assert_array_equal(data["time"].astype("int64"), block.time_ns)
    assert data["loop"].tolist() == [loops[i].name for i in block.loop]
    np.testing.assert_array_equal(data["pv"], block.pv)
    assert data["auto"].dtype == bool
    truth = pd.read_csv(folder / "truth.csv")
    assert list(truth.columns[:6]) == ["loop", "process", "gain", "t0", "dead_time", "lag"]
    np.testing.assert_allclose(truth["t0"], truth["dead_time"] + truth["lag"])
    events = pd.read_csv(folder / "truth_events.csv")
    assert list(events.columns) == ["loop", "kind", "onset", "amplitude"]
    assert set(events["kind"]) == {"setpoint", "load"}
    for row in events[events["kind"] == "setpoint"].itertuples():
        mine = data[data["loop"] == row.loop]
        after = mine[mine["time"] >= row.onset]["sp"].iloc[0]
        before = mine[mine["time"] < row.onset]["sp"].iloc[-1]
        assert after - before == pytest.approx(row.amplitude)


def test_the_exported_table_is_read_back_by_the_monitor(tmp_path):
    loops = [*random_fleet(40, 5), LOOP, LoopSpec("P-1", LOOP.plant, Controller(1.0))]
    write_export(loops, 1.0, tmp_path)
    rows = pd.read_csv(tmp_path / "loops.csv", dtype=str, keep_default_na=False).to_dict("records")
    for loop, row in zip(loops, rows, strict=True):
        read, wrong = parse_row(row)
        assert not wrong
        assert (read.name, read.process, read.form) == (loop.name, loop.plant.process, loop.controller.form)
        assert read.kp == loop.controller.kp
        assert read.ti == pytest.approx(loop.controller.ti)
        assert read.td == pytest.approx(loop.controller.td)
        assert read.structure == loop.controller.structure
        assert read.filter_time == pytest.approx(loop.controller.filter_time * (loop.controller.td > 0))


def test_an_export_in_parts_is_the_same_data(tmp_path, monkeypatch):
    loops = random_fleet(3, 5)
    write_export(loops, 601.5, tmp_path / "whole")
    monkeypatch.setattr("sim_plants.export._CHUNK_SAMPLES", 100)
    write_export(loops, 601.5, tmp_path / "parts")
    whole, parts = (pd.read_parquet(tmp_path / name / "data.parquet") for name in ("whole", "parts"))
    pd.testing.assert_frame_equal(whole, parts)


def test_the_same_export_twice_is_the_same_bytes(tmp_path):
    for name in ("a", "b"):
        write_export(random_fleet(3, 5), 600.0, tmp_path / name)
    for file in ("data.parquet", "loops.csv", "truth.csv", "truth_events.csv"):
        assert (tmp_path / "a" / file).read_bytes() == (tmp_path / "b" / file).read_bytes()
