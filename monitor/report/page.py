"""What all pages share: templates that escape what they are filled with, our styles and scripts, JSON for a script."""

from __future__ import annotations

import base64
import hashlib
import json
from functools import cache
from pathlib import Path

import jinja2
from markupsafe import Markup

from monitor.contract.text import visible

from .words import clock, first_clauses, number, percent

HERE = Path(__file__).parent


@cache
def environment() -> jinja2.Environment:
    """Return what fills our templates: all that is not markup of ours is escaped, and shown as it prints."""
    found = jinja2.Environment(
        loader=jinja2.FileSystemLoader(HERE / "templates"),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        finalize=lambda value: value if isinstance(value, Markup) else visible(value),
    )
    found.filters |= {
        "num": number,
        "percent": percent,
        "clock": clock,
        "clauses": first_clauses,
        "shown": visible,
    }
    return found


def as_json(value: object) -> Markup:
    """Return JSON for a script element: no character of it can end the element, or begin markup."""
    text = json.dumps(value, ensure_ascii=False, allow_nan=False, separators=(",", ":"))
    for character in "<>&\u2028\u2029":
        text = text.replace(character, f"\\u{ord(character):04x}")
    return Markup(text)  # noqa: S704 (escaped above)


def asset(name: str) -> Markup:
    """Return a style or script of ours, as it is."""
    return Markup((HERE / "assets" / name).read_text(encoding="utf-8"))  # noqa: S704 (our own files)


def sha256(text: str) -> str:
    """Return a script's hash, as a content security policy names it."""
    return base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()
