"""Ids of events; records by their loop."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from monitor.contract.records import Spell, by_loop, event_id


@given(st.text(), st.integers(-(2**63), 2**63 - 1), st.text(), st.integers(-(2**63), 2**63 - 1))
def test_an_id_is_of_loop_and_onset_alone(loop, onset, other, later):
    """Sixteen hexadecimal digits, the same in any process; another loop or another time has another one."""
    assert len(event_id(loop, onset)) == 16
    assert int(event_id(loop, onset), 16) >= 0
    assert (event_id(loop, onset) == event_id(other, later)) == ((loop, onset) == (other, later))


def test_an_id_stays_what_it_is():
    """Stored records and audits of years ago bear it."""
    assert event_id("LIC-101", 1_767_225_600 * 10**9) == "55e5fb42a1b2533d"


def test_records_by_their_loop_in_their_order():
    told = [
        Spell(loop=name, start=k, seconds=1.0, error=0.0, error_rms=0.0, op_path=0.0)
        for k, name in enumerate("aba")
    ]
    assert {name: [s.start for s in found] for name, found in by_loop(told).items()} == {
        "a": [0, 2],
        "b": [1],
    }
    assert by_loop([]) == {}
