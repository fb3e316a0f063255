"""The page: whole, self-contained, the same each time, and deaf to what names and texts would like to be."""

from __future__ import annotations

import json
import re
from html.parser import HTMLParser

import pytest

from monitor.contract.figures import MEANINGS
from monitor.report.draw import draw

from .tools import contents, fleet, retune

HOSTILE = (
    "<script>alert(1)</script>",
    "</script><img src=x onerror=alert(1)>",
    "=cmd()|' /C calc'!A0",
    "\u202egnp.exe",
    "a\x1b[31mred",
    '"><svg onload=alert(1)>',
    "{{ 7*7 }}",
)


class Elements(HTMLParser):
    """Elements and attributes of a page."""

    def __init__(self) -> None:
        super().__init__()
        self.found: list[tuple[str, dict[str, str | None]]] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.found.append((tag, dict(attrs)))


def elements(page: str) -> list[tuple[str, dict[str, str | None]]]:
    parser = Elements()
    parser.feed(page)
    return parser.found


def sections(page: str) -> list[dict[str, object]]:
    return [json.loads(t) for t in re.findall(r'class="section">(.*?)</script>', page, re.DOTALL)]


def test_the_same_contents_give_the_same_page() -> None:
    assert draw(contents()) == draw(contents())


def test_page_one_says_how_many_what_first_and_what_cannot_be_told() -> None:
    page = draw(contents())
    text = re.sub(r"\s+", " ", re.sub(r"<[^>]+>", " ", page[: page.index('id="index"')]))
    assert "2026-03-01 00:00 to 2026-03-08 00:00" in text
    for words in ("2 to retune", "1 valve", "1 oscillating", "1 in manual", "1 good", "1 cannot tell"):
        assert words in text, words
    assert "1 loop is near instability" in text
    places = [text.index(name) for name in ("PIC-7", "FIC-2", "TIC-3", "LIC-101")]
    assert places == sorted(places), "near instability, then the valve and other faults, then the slow"
    assert "sample the loop faster" in text
    assert "error after a load step −90% (300 → 30)" in text
    assert "bad.csv: no time column" in text


def test_each_flagged_loop_has_its_section_and_its_charts() -> None:
    found = sections(draw(contents()))
    html = [str(s["html"]) for s in found]
    assert [re.search(r"<h3>(\S+)", h).group(1) for h in html] == [  # type: ignore[union-attr]
        *("PIC-7", "FIC-2", "TIC-3", "LIC-101", "AIC-5", "LIC-6")
    ]
    assert [len(s["events"]) for s in found] == [2, 0, 0, 2, 0, 0]  # type: ignore[arg-type]
    assert [len(s["answers"]) for s in found] == [2, 0, 0, 2, 0, 0]  # type: ignore[arg-type]
    for words in ("type in now", "later, the aim", "GAIN", "canonical units", "series or not?", "way back"):
        assert words in html[3], words


def test_each_health_figure_has_its_meaning_once_in_the_page() -> None:
    page = draw(contents())
    text = re.search(r'id="meanings">(.*?)</script>', page, re.DOTALL)
    assert text is not None
    assert json.loads(text.group(1)) == {name: list(meaning) for name, meaning in MEANINGS.items()}


def test_nothing_is_asked_of_the_network() -> None:
    page = draw(contents())
    for tag, attributes in elements(page):
        for name in ("src", "href", "action", "data", "poster", "xlink:href"):
            value = attributes.get(name)
            assert value is None or value.startswith(("#", "data:,")), (tag, name, value)
    policy = dict(elements(page)[[t for t, _ in elements(page)].index("meta") + 1][1])["content"]
    assert policy is not None
    assert "default-src 'none'" in policy
    assert "unsafe-eval" not in policy
    assert "@import" not in page
    assert "url(" not in page


@pytest.mark.parametrize("name", HOSTILE)
def test_hostile_names_and_texts_are_shown_and_nothing_else(name: str) -> None:
    """As many elements, with the same attributes, as of a harmless name; no character that turns a line around."""
    plain = draw(contents([retune("LIC-101"), *fleet()[1:2]]))
    rows = [retune(name, reason=name, action=f"do {name}", setpoint_moves=name), *fleet()[1:2]]
    page = draw(contents(rows))
    assert [t for t, _ in elements(page)] == [t for t, _ in elements(plain)]
    assert not [a for _, a in elements(page) if any(k.startswith("on") for k in a)]
    for one, other in zip(sections(page), sections(plain), strict=True):
        tags = [t for t, a in elements(str(one["html"])) if not any(k.startswith("on") for k in a)]
        assert [t for t in tags if t not in {"li", "p"}] == [
            t for t, _ in elements(str(other["html"])) if t not in {"li", "p"}
        ]
    assert "\x1b" not in page
    assert "\u202e" not in page


def test_a_fleet_without_anything_makes_a_page() -> None:
    assert "Nothing is to be done" in draw(contents([]))


def test_jobs_that_are_not_listed_are_counted_and_their_loops_stand_in_the_table() -> None:
    page = draw(contents([retune(f"LIC-{k}") for k in range(130)], events=0))
    assert "30 more follow" in page
    index = re.search(r'id="index">(.*?)</script>', page, re.DOTALL)
    assert index is not None
    assert [row[0] for row in json.loads(index.group(1))] == [f"LIC-{k}" for k in range(130)]
