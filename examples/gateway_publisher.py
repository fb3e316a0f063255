"""A publisher for a gateway: samples of many loops to the monitor, one Arrow frame a second.

It needs Zenoh and pyarrow alone: nothing of loopsight has to be where the samples are. Put your own source (OPC UA,
Modbus, a historian's interface) in place of `read`.

python examples/gateway_publisher.py --connect tcp/127.0.0.1:7447 --seconds 60
"""

from __future__ import annotations

import argparse
import json
import math
import time

import pyarrow as pa
import zenoh

LOOPS = ["LIC-101", "PIC-205", "TIC-310"]
KEY = "plant/area1/frame"
"""The last chunk says that it is a frame; what stands before it is yours."""
SCHEMA = pa.schema(
    [
        ("loop", pa.string()),
        ("time", pa.timestamp("ns", tz="UTC")),
        ("sp", pa.float64()),
        ("pv", pa.float64()),
        ("op", pa.float64()),
        ("auto", pa.bool_()),
        ("quality", pa.uint8()),
    ]
)


def read(loop: str, now: float) -> dict[str, float | bool | int]:
    """Return one sample of a loop; a made-up one. Values that are missing stay None or NaN, never 0."""
    phase = now / 60.0 + LOOPS.index(loop)
    return {
        "sp": 50.0,
        "pv": 50.0 + math.sin(phase),
        "op": 40.0 - math.cos(phase),
        "auto": True,
        "quality": 192,
    }


def frame(samples: list[dict[str, object]], number: int) -> bytes:
    """Put samples into an Arrow stream; its number in the metadata lets the monitor see gaps."""
    batch = pa.RecordBatch.from_pylist(samples, schema=SCHEMA.with_metadata({"seq": str(number)}))
    sink = pa.BufferOutputStream()
    with pa.ipc.new_stream(sink, batch.schema) as stream:
        stream.write_batch(batch)
    return sink.getvalue().to_pybytes()


def publish(endpoint: str, seconds: float, period: float = 1.0) -> int:
    """Publish until the time is over; return how many frames have been sent."""
    config = zenoh.Config()
    config.insert_json5("mode", '"client"')
    config.insert_json5("connect/endpoints", json.dumps([endpoint]))
    config.insert_json5("scouting/multicast/enabled", "false")
    number = 0
    with zenoh.open(config) as session:
        publisher = session.declare_publisher(KEY, encoding="application/vnd.apache.arrow.stream")
        first = time.monotonic()
        while time.monotonic() - first < seconds:
            now = time.time()
            stamp = round(now * 1e9)
            samples = [{"loop": loop, "time": stamp, **read(loop, now)} for loop in LOOPS]
            publisher.put(frame(samples, number))
            number += 1
            # from one full period to the next: a slow source makes no drift
            time.sleep(max(0.0, first + number * period - time.monotonic()))
    return number


if __name__ == "__main__":
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--connect", default="tcp/127.0.0.1:7447", help="Zenoh endpoint of monitor or router")
    parser.add_argument("--seconds", type=float, default=math.inf, help="end after this time [s]")
    parser.add_argument("--period", type=float, default=1.0, help="time between two frames [s]")
    given = parser.parse_args()
    print(f"{publish(given.connect, given.seconds, given.period)} frames sent")
