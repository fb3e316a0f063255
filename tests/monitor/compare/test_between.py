"""Two audits: loops by name, in the order of the later one; what is new, missing, renamed, or of an earlier version."""

from __future__ import annotations

from monitor.compare.between import compare
from monitor.contract.changes import BETTER, MISSING, NEW, UNCLEAR

from .tools import audit, events, row


def test_loops_are_compared_with_their_own_events() -> None:
    slow, fast = [0.3] * 6, [0.8] * 6
    old = audit([row("A"), row("B"), row("GONE")], events(slow, "A") + events(fast, "B"))
    new = audit([row("B"), row("NEW"), row("A", kp=4.0)], events(fast, "A") + events(fast, "B"))
    found = compare(old, new)
    assert [c.loop for c in found.loops] == ["B", "NEW", "A", "GONE"]
    assert [c.outcome for c in found.loops] == ["same", NEW, BETTER, MISSING]
    assert (found.shared, found.counts[NEW], found.counts[MISSING], found.counts[UNCLEAR]) == (2, 1, 1, 0)
    assert (found.renamed, found.notes) == ((), ())


def test_what_looks_renamed_is_said_where_there_is_one_such_pair() -> None:
    old = audit([row("LIC-101"), row("TIC-7"), row("PIC-1")])
    new = audit([row("SITE1:LIC101"), row("tic_7"), row("X/PIC-1"), row("Y/PIC-1"), row("FIC-9")])
    assert compare(old, new).renamed == (("LIC-101", "SITE1:LIC101"), ("TIC-7", "tic_7"))


def test_an_earlier_version_is_named_with_what_it_lacks() -> None:
    old = audit([row("A")], lacks=tuple(f"c{k}" for k in range(10)))
    (note,) = compare(old, audit([row("A")])).notes
    assert note.startswith("audit (loopsight 0.1.0): has no c0, c1,")
    assert "and 2 more: what rests on them is not compared" in note
