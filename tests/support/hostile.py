"""Names that are made to harm where they are shown or used as a path."""

from __future__ import annotations

HOSTILE = [
    "../../etc/passwd",
    "<script>alert(1)</script>",
    "=cmd()",
    "a/*/b",
    "/abs/**",
    "\u202eLIC\u2066-1",
    "| x | **b** | [l](http://x) `c`",
    "tab\there\nline",
    "\x1b]0;owned\x07\x1b[2JLIC",
    "",
    "ü" * 100,
    "\ud800",
]
