"""The report in a real browser without a head: search, sort, filter, open a loop; no error, no request."""

from __future__ import annotations

import os
import shutil
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from monitor.contract.records import LoopRow
from monitor.report.draw import draw
from tests.monitor.report.tools import contents, fleet, retune

BROWSERS = ("chromium", "chromium-browser", "google-chrome", "chrome")
HOSTILE = "<img src=x onerror=\"document.title='owned'\">"

sync_api = pytest.importorskip(
    "playwright.sync_api", reason="playwright is not installed: pip install playwright"
)


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    """A browser of the machine's own, since playwright's may not be there."""
    found = os.environ.get("LOOPSIGHT_CHROMIUM") or next(filter(None, map(shutil.which, BROWSERS)), None)
    if found is None:
        pytest.skip(f"no browser: none of {', '.join(BROWSERS)} on the path, nor in LOOPSIGHT_CHROMIUM")
    with sync_api.sync_playwright() as playwright:
        # a container's root has no sandbox; what is opened is our own file
        started = playwright.chromium.launch(executable_path=found, args=["--no-sandbox"])
        yield started
        started.close()


class Opened:
    """A page, and all that it said and asked for."""

    def __init__(self, browser: Any, path: Path, rows: list[LoopRow], events: int = 2) -> None:
        path.write_text(draw(contents(rows, events)), encoding="utf-8")
        self.page = browser.new_page(viewport={"width": 1280, "height": 900})
        self.said: list[str] = []
        self.asked: list[str] = []
        self.page.on("console", lambda message: self.said.append(message.text))
        self.page.on("pageerror", lambda error: self.said.append(str(error)))
        self.page.on("request", lambda request: self.asked.append(request.url))
        began = time.perf_counter()
        self.page.goto(path.as_uri())
        self.page.wait_for_selector("html[data-ready]", state="attached")
        self.seconds = time.perf_counter() - began

    def names(self) -> list[str]:
        return [cell.inner_text() for cell in self.page.query_selector_all("#table tbody td:nth-child(2)")]

    def quiet(self) -> bool:
        """Whether nothing was said, and nothing but the page itself asked for."""
        return self.said == [] and len(self.asked) == 1 and self.asked[0].startswith("file:")


@pytest.fixture
def opened(browser: Any, tmp_path: Path) -> Iterator[Opened]:
    found = Opened(browser, tmp_path / "report.html", fleet())
    yield found
    assert found.quiet(), (found.said, found.asked)
    found.page.close()


def test_search_sort_and_filter(opened: Opened) -> None:
    page = opened.page
    assert opened.names() == [row.loop for row in fleet()]
    page.fill("#search", "VALVE sticks")
    assert opened.names() == ["FIC-2"]
    page.keyboard.press("Escape")
    page.click("#table [data-sort=name]")
    assert opened.names() == ["AIC-5", "FIC-2", "LIC-6", "LIC-8", "LIC-101", "PIC-7", "TIC-3"]
    page.click("#table [data-sort=ms]")
    assert opened.names()[:3] == ["PIC-7", "LIC-8", "TIC-3"]  # the least robust first, the unknown last
    page.click(".tile[data-kind=manual]")
    assert opened.names() == ["LIC-6"]
    assert page.inner_text("#found") == "1 of 7 loops"


def test_a_loop_opens_with_its_charts_and_closes_by_the_keyboard(opened: Opened) -> None:
    page = opened.page
    page.click("#shut")
    page.click("#table [data-loop='LIC-101']")
    section = page.wait_for_selector(".loop[aria-label='LIC-101']")
    section.wait_for_selector(".answers canvas")
    section.query_selector(".events .plot:last-child").scroll_into_view_if_needed()
    page.wait_for_function("document.querySelectorAll('.loop canvas').length >= 8")
    assert "way back" in section.inner_text()
    drawn = section.query_selector(".events canvas").evaluate(
        "c => new Set(c.getContext('2d').getImageData(0, 0, c.width, c.height).data).size"
    )
    assert drawn > 20  # not an empty picture
    page.keyboard.press("Escape")
    assert page.query_selector(".loop") is None


def test_what_is_open_is_printed_with_its_charts(opened: Opened) -> None:
    opened.page.emulate_media(media="print")
    assert opened.page.pdf()[:4] == b"%PDF"
    assert opened.page.evaluate(
        "[...document.querySelectorAll('.holder')].every((h) => h.querySelector('canvas'))"
    )


def test_a_hostile_name_is_text(browser: Any, tmp_path: Path) -> None:
    found = Opened(browser, tmp_path / "report.html", [retune(HOSTILE, reason=HOSTILE, action=HOSTILE)])
    found.page.click("#table .link")
    assert HOSTILE in found.page.inner_text(".loop h3")
    assert found.page.title().startswith("Control loops")
    assert found.page.query_selector("img") is None
    assert found.quiet(), (found.said, found.asked)


@pytest.mark.slow
def test_five_thousand_loops_open(browser: Any, tmp_path: Path) -> None:
    rng = np.random.default_rng(5)
    ci, ms = np.exp(rng.normal(-0.6, 0.7, 5000)), 1.0 + np.exp(rng.normal(-0.5, 0.5, 5000))
    rows = [
        retune(f"LIC-{k:04}", ci_setpoint=float(ci[k]), ms=float(ms[k]), events=int(rng.integers(1, 90)))
        if k < 1500
        else LoopRow(
            loop=f"TIC-{k:04}", verdict="good", ci_setpoint=float(ci[k]), ms=float(ms[k]), coverage=1.0
        )
        for k in range(5000)
    ]
    found = Opened(browser, tmp_path / "report.html", rows, events=4)
    size = (tmp_path / "report.html").stat().st_size
    print(
        f"5,000 loops, 1,500 flagged, 800 with charts: {size / 1e6:.1f} MB, ready after {found.seconds:.2f} s"
    )
    found.page.fill("#search", "LIC-0799")
    assert found.names() == ["LIC-0799"]
    found.page.click("#table .link")
    found.page.wait_for_selector(".loop[aria-label='LIC-0799'] canvas")
    assert found.quiet(), (found.said[:3], found.asked[:3])
