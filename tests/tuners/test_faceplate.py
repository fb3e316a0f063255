"""Faceplates: round trip, and each block's own difference equation beside the canonical one."""

import math

import numpy as np
import pytest

from tuners.blocks import BLOCKS, find_block
from tuners.faceplate import fields_of, from_block, to_block
from tuners.settings import NotRepresentableError, Settings

PV_SPAN, OP_SPAN = 50.0, 200.0
SPANS = {"pv_span": PV_SPAN, "op_span": OP_SPAN}


def fitting(block):
    """Settings that the block can hold to the last digit: its form, filter and set-point structure."""
    ratio = 0.1 if block.filter_ratio is None else block.filter_ratio
    b, c = next(iter(block.structures.values()), (1.0, 1.0))
    return Settings(-1.3, 47.0, 6.0, ratio * 6.0, block.form, float(b), float(c))


@pytest.mark.parametrize("name", BLOCKS)
def test_round_trip(name):
    block = BLOCKS[name]
    settings = fitting(block)
    for sign in (1, -1):
        signed = Settings(
            sign * settings.kp, settings.ti, settings.td, settings.tf, settings.form, settings.b, settings.c
        )
        plate = to_block(signed, block, **SPANS)
        back = from_block(plate.fields, block, **SPANS)
        assert back == plate.settings
        for field in ("kp", "ti", "td", "tf", "b", "c"):
            assert getattr(back, field) == pytest.approx(getattr(signed, field), rel=1e-12)


@pytest.mark.parametrize("name", BLOCKS)
def test_round_trip_of_every_form_and_structure(name):
    block = BLOCKS[name]
    for form in block.forms:
        for b, c in block.structures.values() or [(1, 1)]:
            settings = Settings(0.4, 90.0, 5.0, 0.5, form, float(b), float(c))
            back = to_block(settings, block, **SPANS).settings
            assert (back.form, back.b, back.c) == (form, b, c)
            assert (back.kp, back.ti, back.td) == pytest.approx((0.4, 90.0, 5.0), rel=1e-12)


# What the blocks compute, written from their manuals' names and units and not from blocks.toml: gain as % of
# OP span for % of PV span ("%") or in engineering units ("EU"), then what stands behind each field in seconds.
EQUATIONS = {
    "deltav-pid": ("standard", "%", lambda f: (f["GAIN"], f["RESET"], f["RATE"], f["ALPHA"] * f["RATE"])),
    "provox-pid": ("series", "%", lambda f: (f["GAIN"], 60 / f["RESET"], 60 * f["RATE"], 6 * f["RATE"])),
    "fieldbus-pid": ("standard", "%", lambda f: (f["GAIN"], f["RESET"], f["RATE"], f["RATE"] / 10)),
    "fieldbus-pid-yokogawa": ("standard", "%", lambda f: (f["GAIN"], f["RESET"], f["RATE"], f["RATE"] / 10)),
    "ovation-pid": (
        "series", "%",
        lambda f: (f["gain"], f["integral time"], f["derivative time"], f["derivative time"] / 10),
    ),
    "honeywell-tdc-pid": ("series", "%", lambda f: (f["K"], 60 * f["T1"], 60 * f["T2"], 6 * f["T2"])),
    "honeywell-udc-pid": (
        "standard", "%", lambda f: (f["GAIN"], 60 * f["RSET MIN"], 60 * f["RATE MIN"], 6 * f["RATE MIN"])
    ),
    "honeywell-udc-pid-pb": (
        "standard", "%", lambda f: (100 / f["PROP BD"], 60 / f["RSET RPM"], 60 * f["RATE MIN"], 6 * f["RATE MIN"])
    ),
    "foxboro-pid": (
        "series", "%", lambda f: (100 / f["PBAND"], 60 * f["INT"], 60 * f["DERIV"], 60 * f["DERIV"] / f["KD"])
    ),
    "foxboro-pida": (
        "standard", "%", lambda f: (100 / f["PBAND"], 60 * f["INT"], 60 * f["DERIV"], 60 * f["DERIV"] / f["KD"])
    ),
    "centum-pid": ("standard", "%", lambda f: (100 / f["P"], f["I"], f["D"], f["D"] / 10)),
    "yokogawa-up": ("standard", "%", lambda f: (100 / f["P"], f["I"], f["D"], f["D"] / 10)),
    "abb-800xa-pidcc": ("standard", "%", lambda f: (f["Gain"], f["Ti"], f["Td"], f["Tf"])),
    "infi90-fc19": (
        "parallel", "EU",
        lambda f: (
            f["S5 K"] * f["S6 KP"], f["S5 K"] * f["S7 KI"] / 60, 60 * f["S5 K"] * f["S8 KD"],
            6 * f["S8 KD"] / f["S6 KP"],
        ),
    ),
    "infi90-fc156": (
        "parallel", "EU",
        lambda f: (
            f["S11 K"] * f["S12 KP"], f["S11 K"] * f["S13 KI"] / 60, 60 * f["S11 K"] * f["S14 KD"],
            60 * f["S14 KD"] / f["S12 KP"] / f["S15 KA"],
        ),
    ),
    "abb-drive-pid": (
        "standard", "%",
        lambda f: (f["gain"], f["integration time"], f["derivation time"], f["derivation filter time"]),
    ),
    "pcs7-ctrl-pid": ("standard", "EU", lambda f: (f["GAIN"], f["TN"], f["TV"], f["TM_LAG"])),
    "pcs7-pidconl": ("standard", "%", lambda f: (f["GAIN"], f["TI"], f["TD"], f["TD"] / f["DiffGain"])),
    "apacs-pid": ("standard", "%", lambda f: (f["GAIN"], 60 * f["TI"], 60 * f["TD"], 60 * f["TD"] / f["DG"])),
    "s7-pid-compact": ("standard", "EU", lambda f: (f["Gain"], f["Ti"], f["Td"], f["TdFiltRatio"] * f["Td"])),
    "tcont-cp": ("standard", "EU", lambda f: (f["GAIN"], f["TI"], f["TD"], f["TD"] / f["D_F"])),
    "logix-pid-dependent": ("standard", "%", lambda f: (f["Kc"], 60 * f["Ti"], 60 * f["Td"], 6 * f["Td"])),
    "logix-pid-independent": ("parallel", "%", lambda f: (f["Kp"], f["Ki"], f["Kd"], f["Kd"] / f["Kp"] / 10)),
    "logix-pide-independent": (
        "parallel", "%",
        lambda f: (f["PGain"], f["IGain"] / 60, 60 * f["DGain"], 6 * f["DGain"] / f["PGain"]),
    ),
    "logix-pide-dependent": ("standard", "%", lambda f: (f["PGain"], 60 * f["IGain"], 60 * f["DGain"], 6 * f["DGain"])),
    "slc-pid": ("standard", "%", lambda f: (0.1 * f["Kc"], 6 * f["Ti"], 0.6 * f["Td"], 0.06 * f["Td"])),
    "schneider-pidff": ("standard", "EU", lambda f: (f["kp"], f["ti"], f["td"], f["td"] / f["kd"])),
    "schneider-pidp1": ("parallel", "EU", lambda f: (f["KP"], f["KI"], f["KD"], f["KD"] / f["KP"] / 10)),
    "mitsubishi-ppid": ("standard", "%", lambda f: (f["P"], f["I"], f["D"], 0.1 * f["D"])),
    "ifix-pid": (
        "standard", "%", lambda f: (100 / f["proportional band"], 60 * f["reset"], 60 * f["rate"], 6 * f["rate"])
    ),
    "temco-t3": (
        "standard", "%", lambda f: (100 / f["proportional band"], 3600 / f["reset"], 60 * f["rate"], 6 * f["rate"])
    ),
}  # fmt: skip

DT = 0.25


class VendorPid:
    """The block's own difference equation on the error: series as a cascade, parallel in gains, velocity form."""

    def __init__(self, form, gain, integral, derivative, tf):
        self.form, self.gain, self.integral, self.derivative, self.tf = form, gain, integral, derivative, tf
        self.out = self.last = self.slope = self.led = 0.0

    def step(self, e):
        if self.form == "series":
            before = self.led
            self.led = (self.tf * self.led + self.derivative * (e - self.last) + DT * e) / (self.tf + DT)
            self.out += self.gain * (self.led - before + DT / self.integral * self.led)
        else:
            before = self.slope
            self.slope = (self.tf * self.slope + e - self.last) / (self.tf + DT)
            ki, kd = self.integral, self.derivative
            if self.form == "standard":
                ki, kd = self.gain / self.integral, self.gain * self.derivative
            self.out += self.gain * (e - self.last) + ki * DT * e + kd * (self.slope - before)
        self.last = e
        return self.out


class CanonicalPid:
    """Standard form in engineering units, position form, backward differences."""

    def __init__(self, settings):
        self.settings = settings.to("standard")
        self.area = self.slope = self.last = 0.0

    def step(self, e):
        s = self.settings
        self.area += DT * e
        self.slope = (s.tf * self.slope + e - self.last) / (s.tf + DT)
        self.last = e
        return s.kp * (e + self.area / s.ti + s.td * self.slope)


def close_loop(controller, gain, count=2000):
    """PV of an integrator with lag and dead time after a load step and a set-point step, PV structure 1, 1."""
    flow, pv, trace, delayed = 0.0, 0.0, [], [0.0] * 24
    for k in range(count):
        setpoint = 1.0 if k > count // 2 else 0.0
        delayed.append(controller(setpoint - pv) + 1.0)
        flow += DT / 8.0 * (delayed.pop(0) - flow)
        pv += DT * gain * flow
        trace.append(pv)
    return np.array(trace)


@pytest.mark.parametrize("name", BLOCKS)
def test_own_difference_equation_gives_the_same_loop(name):
    """The block, fed with its faceplate, and the canonical controller: PV equal to 0.1 % of its peak."""
    block = BLOCKS[name]
    settings = Settings(-1.3, 60.0, 5.0, 0.5, "standard")
    plate = to_block(settings, block, **SPANS)
    form, basis, read = EQUATIONS[name]
    if block.form_field:
        assert plate.fields[block.form_field] == block.form_values["standard"]
        form = "standard"
    vendor = VendorPid(form, *read(plate.fields))
    assert abs(vendor.tf - plate.settings.tf) < 1e-12
    # Direct acting: the action, where there is one, turns the error round; else the gain carries the sign.
    sign = -1.0 if block.action and plate.fields[block.action] == block.direct else 1.0
    unit = (100 / PV_SPAN, OP_SPAN / 100) if basis == "%" else (1.0, 1.0)
    own = close_loop(lambda e: unit[1] * vendor.step(sign * unit[0] * e), -0.02)
    canonical = CanonicalPid(plate.settings)
    expected = close_loop(canonical.step, -0.02)
    assert np.abs(own - expected).max() < 1e-3 * np.abs(expected).max()
    assert np.abs(expected[-1] - 1.0) < 0.05


def test_every_block_has_its_equation_and_there_are_enough():
    assert set(EQUATIONS) == set(BLOCKS)
    assert len(BLOCKS) >= 20


def test_parallel_integral_time_is_not_one_over_ki():
    """A widely copied page says Ti = 1/Ki and Td = Kd; right is Kp/Ki and Kd/Kp."""
    block = find_block("logix-pid-independent")
    settings = from_block({"Kp": 2.0, "Ki": 0.05, "Kd": 8.0}, block, pv_span=100, op_span=100)
    assert (settings.ti, settings.td) == pytest.approx((2.0 / 0.05, 8.0 / 2.0))
    assert settings.ti != pytest.approx(1 / 0.05)
    assert settings.td != pytest.approx(8.0)


def test_pide_integral_gain_is_per_minute():
    """A widely copied page takes the PIDE's Ki as 1/s; it is 1/min, and Kd is in minutes."""
    block = find_block("logix-pide-independent")
    settings = from_block({"PGain": 2.0, "IGain": 3.0, "DGain": 0.5}, block, pv_span=100, op_span=100)
    assert (settings.ti, settings.td) == pytest.approx((2.0 / 3.0 * 60, 0.5 / 2.0 * 60))
    assert settings.ti != pytest.approx(2.0 / 3.0)


def test_spans_turn_the_gain():
    """Kc [%/%] = Kc [OP/PV] PV span / OP span."""
    assert to_block(Settings(1.2, 30.0), find_block("deltav-pid"), **SPANS).fields["GAIN"] == pytest.approx(
        0.3
    )
    assert to_block(Settings(1.2, 30.0), find_block("centum-pid"), **SPANS).fields["P"] == pytest.approx(
        100 / 0.3
    )
    assert to_block(Settings(1.2, 30.0), find_block("pcs7-ctrl-pid")).fields["GAIN"] == pytest.approx(1.2)
    with pytest.raises(ValueError, match="pv_span"):
        to_block(Settings(1.2, 30.0), find_block("deltav-pid"))
    with pytest.raises(ValueError, match="op_span = 0"):
        to_block(Settings(1.2, 30.0), find_block("deltav-pid"), pv_span=1, op_span=0)


def test_integral_off():
    assert to_block(Settings(1.0), find_block("s7-pid-compact")).fields["Ti"] == 0.0
    assert to_block(Settings(1.0), find_block("fieldbus-pid"), **SPANS).fields["RESET"] == math.inf
    assert to_block(Settings(1.0), find_block("provox-pid"), **SPANS).fields["RESET"] == 0.0
    assert to_block(Settings(1.0), find_block("provox-pid"), **SPANS).settings.ti == math.inf
    with pytest.raises(NotRepresentableError, match="RESET"):
        to_block(Settings(1.0), find_block("deltav-pid"), **SPANS)


def test_form_that_cannot_hold_the_settings_refuses():
    """ti < 4 td has no series form; a block with both forms keeps the one that can."""
    short = Settings(1.0, 10.0, 4.0, 0.4)
    for name in ("provox-pid", "foxboro-pid"):
        with pytest.raises(NotRepresentableError, match="ti must be at least"):
            to_block(short, find_block(name), **SPANS)
    assert to_block(short, find_block("honeywell-tdc-pid"), **SPANS).settings.form == "standard"
    parallel = Settings(1.0, 10.0, 4.0, 0.4, "parallel")
    assert to_block(parallel, find_block("honeywell-tdc-pid"), **SPANS).settings.form == "standard"


def test_what_the_user_must_know_is_said():
    notes = to_block(Settings(1.0, 90.0, 5.0, 0.1, c=0.0), find_block("ovation-pid"), **SPANS).notes
    assert any("not verified" in note for note in notes)
    assert any("filter" in note for note in notes)
    assert any("weights" in note for note in notes)
    limited = to_block(Settings(1.0, 90.0, 5.0, 0.1), find_block("deltav-pid"), **SPANS)
    assert limited.fields["ALPHA"] == 0.05
    assert limited.settings.tf == pytest.approx(0.25)
    assert any("ALPHA" in note for note in limited.notes)


def test_report_fields():
    class Loop:
        pv_low, pv_high, op_low, op_high = 0.0, 50.0, 0.0, 200.0

    class Unknown(Loop):
        op_high = None

    fields = fields_of(find_block("centum-pid"), Settings(1.2, 30.0), Loop())
    assert fields["P"] == pytest.approx(100 / 0.3)
    assert "not verified" in fields["note"]
    assert list(fields_of(find_block("centum-pid"), Settings(1.2, 30.0), Unknown())) == ["unavailable"]


@pytest.mark.parametrize(
    ("fields", "match"),
    [
        ({"Kp": 1.0, "Ki": 0.1}, "Kd: missing"),
        ({"Kp": "high", "Ki": 0.1, "Kd": 0.0}, "Kp = 'high'"),
        ({"Kp": 0.0, "Ki": 0.1, "Kd": 0.0}, "Kp = 0"),
        ({"Kp": 1.0, "Ki": -0.1, "Kd": 0.0}, "Ki = -0.1"),
        ({"Kp": 1.0, "Ki": 0.1, "Kd": 0.0, "CA": "sideways"}, "CA = 'sideways'"),
    ],
)
def test_wrong_fields_are_named(fields, match):
    with pytest.raises(ValueError, match=match):
        from_block(fields, find_block("logix-pid-independent"), **SPANS)


def test_a_gain_of_zero_has_no_faceplate():
    with pytest.raises(ValueError, match="kp"):
        to_block(Settings(0.0), find_block("deltav-pid"), **SPANS)
