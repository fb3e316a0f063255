"""Tags to loops and roles, in every spelling."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from monitor.adapters.historian.tag_roles import loop_names, loops_of_tags, read_tag, role_of

WORDS = {
    "sp": ("SP", "SV", "SPT", "SetPoint", "Sollwert", "set_point"),
    "pv": ("PV", "MEAS", "PV_IN", "ProcessValue", "Istwert", "Process Value"),
    "op": ("OP", "OUT", "MV", "CV", "CO", "LMN", "Output", "Stellwert", "Stellgröße", "Stellgroesse"),
    "auto": ("MODE", "Mode", "A/M", "Betriebsart", "AUTO", "MODE.ACTUAL"),
}
LOOP = st.from_regex(r"[LFTP]IC[-]?[1-9][0-9]{1,3}[AB]?", fullmatch=True)
CASES = st.sampled_from((str, str.upper, str.lower))


@given(loop=LOOP, separator=st.sampled_from("._/:-| "), data=st.data())
def test_each_word_says_its_role(loop: str, separator: str, data: st.DataObject) -> None:
    """Behind any separator, in any case, under any path."""
    role = data.draw(st.sampled_from(sorted(WORDS)))
    word = data.draw(CASES)(data.draw(st.sampled_from(WORDS[role])))
    path = data.draw(
        st.sampled_from(("", "[default]Area1/", "SITE1:", "Plant.Unit.", "ns=2;s=", r"\\\\PISRV\\"))
    )
    tag = read_tag(f"{path}{loop}{separator}{word}")
    assert tag is not None
    assert tag.role == role
    assert tag.stem == f"{path}{loop}"
    assert loop_names([tag.stem])[tag.stem] == loop


@pytest.mark.parametrize(
    "name", ["TI-100", "ambient temperature", "PV", "LIC-101", "LIC-101.KP", "LIC-101.ALARM", ""]
)
def test_what_says_no_role_has_none(name: str) -> None:
    assert read_tag(name) is None


def test_roles_alone() -> None:
    assert [role_of(w) for w in ("Set Point", "PV (%)", "A/M", "flow")] == ["sp", "pv", "auto", None]
    assert role_of("STELLGRÖSSE") == role_of("Stellgröße") == "op"


def test_the_actual_mode_goes_before_the_plain_one_and_the_target_is_not_used() -> None:
    names = [f"LIC-1.{w}" for w in ("SP", "PV", "OP", "MODE", "MODE.ACTUAL", "MODE.TARGET")]
    found = loops_of_tags(names)
    assert found.loops["LIC-1"]["auto"] == "LIC-1.MODE.ACTUAL"
    assert set(found.unused) == {"LIC-1.MODE", "LIC-1.MODE.TARGET"}


def test_two_tags_of_one_role_are_doubtful_and_so_is_a_tag_of_manual() -> None:
    twice = loops_of_tags(["A.SP", "A.PV", "A.OUT", "A.MV"])
    assert set(twice.doubtful) == {"A.OUT", "A.MV"}
    manual = loops_of_tags(["A.SP", "A.PV", "A.OP", "A.MAN"])
    assert "in manual" in manual.doubtful["A.MAN"]
    assert not loops_of_tags(["A.SP", "A.PV", "A.OP", "A.MAN", "A.MODE"]).doubtful


def test_a_bare_tag_is_the_measured_value_of_its_loop() -> None:
    assert loops_of_tags(["LIC-1", "LIC-1.SP", "LIC-1.OP"]).loops["LIC-1"]["pv"] == "LIC-1"
    assert loops_of_tags(["LI-1", "LIC-1.SP", "LIC-1.OP"]).unused == ["LI-1"]


def test_only_the_measured_values_quality_is_the_loops() -> None:
    names = [f"A.{w}" for w in ("SP", "PV", "OP", "PV.QUALITY", "OP.QUALITY")]
    assert loops_of_tags(names).loops["A"]["quality"] == "A.PV.QUALITY"


def test_names_of_the_loop_table_go_before_all() -> None:
    assert loop_names(["SITE1:LIC101"], ["LIC-101"]) == {"SITE1:LIC101": "LIC-101"}
    assert loop_names(["A/LIC-1", "B/LIC-1"], ["A/LIC-1"])["A/LIC-1"] == "A/LIC-1"


def test_loops_of_one_tag_keep_their_paths() -> None:
    assert loop_names(["A/LIC-1", "B/LIC-1"]) == {"A/LIC-1": "A/LIC-1", "B/LIC-1": "B/LIC-1"}
    assert loop_names(["10-LIC-1", "20-LIC-1"]) == {"10-LIC-1": "10-LIC-1", "20-LIC-1": "20-LIC-1"}
    assert loop_names(["Plant.heater", "Plant.cooler"]) == {
        "Plant.heater": "heater",
        "Plant.cooler": "cooler",
    }
