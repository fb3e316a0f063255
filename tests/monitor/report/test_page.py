"""What all pages share: nothing that fills a template becomes markup, and no JSON ends its script element."""

from __future__ import annotations

import json

from monitor.report.page import as_json, asset, environment, sha256


def test_what_fills_a_template_is_escaped_and_printable() -> None:
    shown = environment().from_string("{{ name }}").render(name="<b>\x1b[31m\u202e")
    assert shown == "&lt;b&gt;\\x1b[31m\\u202e"


def test_json_cannot_end_its_element() -> None:
    value = {"name": "</script><!--&\u2028"}
    text = as_json(value)
    assert not set("<>&\u2028") & set(text)
    assert json.loads(text) == value


def test_styles_and_scripts_are_ours() -> None:
    assert ".tile" in asset("report.css")
    assert sha256("") == "47DEQpj8HBSa+/TImW+5JCeuQeRkm5NMpJWZG3hSuFU="
