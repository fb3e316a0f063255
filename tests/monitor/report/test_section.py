"""A loop's section: settings today, now and later in faceplate fields and canonical units; what is not known."""

from __future__ import annotations

import json
import math

from monitor.contract.figures import MEANINGS
from monitor.contract.records import LoopRow
from monitor.report.section import health_of, section_of

from .tools import retune


def test_settings_go_from_today_over_now_to_later() -> None:
    settings = section_of(retune(), [], None)["settings"]
    assert settings["heads"] == ["today", "type in now", "later, the aim"]
    assert dict(settings["faceplate"]) == {"GAIN": ["0.75", "1.9", "2.8"], "RESET": ["300", "90", "80"]}
    canonical = {name: (unit, values) for name, unit, values in settings["canonical"]}
    assert canonical["kp"] == ("OP/PV", ["1.2", "3", "4.5"])
    assert settings["remarks"] == ["series or not?"]
    assert settings["rollback"]


def test_no_integral_action_is_said_in_words() -> None:
    row = retune(ti=math.inf, fields=None, new_fields=None, stage_fields=None)
    settings = section_of(row, [], None)["settings"]
    assert settings["faceplate"] == []
    assert {n: v for n, _, v in settings["canonical"]}["ti"] == ["none", "90", "80"]


def test_a_parallel_form_has_its_own_names_on_both_sides() -> None:
    stages = json.dumps([{"kp": 3.0, "ki": 0.03, "kd": 0.0, "tf": 0.0}])
    row = retune(fields=None, new_fields=None, stage_fields=None, stages=stages, form="parallel")
    canonical = {n: v for n, _, v in section_of(row, [], None)["settings"]["canonical"]}
    assert canonical["ki"] == ["0.004", "0.03"]


def test_what_is_not_known_is_left_out() -> None:
    section = section_of(LoopRow(loop="x"), [], None)
    assert section["settings"] is None
    assert section["model"] == section["promises"] == []
    assert health_of(LoopRow(loop="x")) == []


def test_each_health_figure_that_is_known_is_shown() -> None:
    row = retune(**dict.fromkeys(MEANINGS, 0.5))
    assert health_of(row) == [(name, "0.5") for name in MEANINGS]


def test_choices_of_a_block_are_words_and_an_overshoot_is_in_per_cent() -> None:
    row = retune(
        fields=json.dumps({"direct": True}), stage_fields=json.dumps([{"direct": True}, {"direct": False}])
    )
    section = section_of(row, [], None)
    assert section["settings"]["faceplate"] == [("direct", ["yes", "yes", "no"])]
    assert section["promises"][1] == ("Ms, worst model that the data allow", "", "1.8")
    promises = section_of(retune(overshoot=0.394, new_overshoot=1e-9), [], None)["promises"]
    assert ("overshoot after a set-point step", "39 %", "0 %") in promises
