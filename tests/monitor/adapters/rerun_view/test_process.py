"""Rerun's server and viewer: no telemetry, only our own page, a picture that is drawn."""

from __future__ import annotations

import urllib.request
from pathlib import Path

import msgspec
import numpy as np
import pytest

from monitor.adapters.rerun_view import process as rerun_process
from monitor.adapters.rerun_view import series
from monitor.view.process import start_view
from tests import screenshot_view
from tests.support.fake_monitor import FakeMonitor
from tests.support.waiting import PATIENCE, until


def test_telemetry_is_off() -> None:
    """Rerun's program is told so, for this child alone; the browser may talk to this machine only."""
    server = rerun_process.serve_web()
    try:
        with urllib.request.urlopen(server.url, timeout=PATIENCE) as page:
            rules = page.headers["Content-Security-Policy"]
        assert "default-src 'self'" in rules
        sources = [word for rule in rules.split(";") for word in rule.split()[1:] if "//" in word]
        assert sources == [server.proxy.removeprefix("rerun+").removesuffix("/proxy")]
        posing = urllib.request.Request(server.url, headers={"Host": "evil.example"})
        with pytest.raises(urllib.error.HTTPError, match="403") as refused:
            urllib.request.urlopen(posing, timeout=PATIENCE)
        refused.value.close()
        facts = msgspec.json.decode((Path(server._folder.name) / "rerun" / "analytics.json").read_bytes())
        assert facts["analytics_enabled"] is False
    finally:
        server.stop()


def test_picture_is_drawn(tmp_path: Path, fake: FakeMonitor) -> None:
    """Rerun's own viewer shows the curves: their colours are on the screen."""
    if why := screenshot_view.missing():
        pytest.skip(why)
    from PIL import Image  # noqa: PLC0415 - comes with rerun

    colours = (
        series.PV_COLOUR,
        series.OP_COLOUR,
        series.ONSET_COLOUR,
        series.MODEL_COLOUR,
    )
    png = tmp_path / "v.png"

    def all_drawn() -> bool:
        save(png)
        with Image.open(png) as picture:
            pixels = np.asarray(picture.convert("RGB"), dtype=int).reshape(-1, 3)
        return all((np.abs(pixels - np.array(c)).max(axis=1) < 40).sum() > 30 for c in colours)

    view = start_view(fake.endpoint, "web")
    try:
        assert view.url
        with screenshot_view.headless(view.url, "900x600") as save:
            until(all_drawn)
    finally:
        view.stop()
