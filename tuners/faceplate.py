"""Settings to and from the fields of a vendor block, as its faceplate shows them.

The canonical form is `Settings` in engineering units; a block may count in per cent of the spans, minutes,
repeats, proportional band, or gains of a parallel form.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

from tuners.blocks import RATE_UNITS, TIME_UNITS, Block
from tuners.settings import FILTER_RATIO, NotRepresentableError, Settings

Value = float | str


class Ranges(Protocol):
    """What knows the ranges of PV [PV] and OP [OP], a loop say; None where not known."""

    @property
    def pv_low(self) -> float | None:
        """Lower end of PV [PV]."""

    @property
    def pv_high(self) -> float | None:
        """Upper end of PV [PV]."""

    @property
    def op_low(self) -> float | None:
        """Lower end of OP [OP]."""

    @property
    def op_high(self) -> float | None:
        """Upper end of OP [OP]."""


def _span(low: float | None, high: float | None) -> float | None:
    return None if low is None or high is None else high - low


@dataclass(frozen=True, slots=True)
class Faceplate:
    """Settings as a block shows them.

    Parameters
    ----------
    block
        The block.
    fields
        Value of each field, by its name.
    units
        Unit of each field; empty for choices.
    settings
        What the block does with these fields: its own form and set-point structure.
    notes
        What the user must know: rows that are not verified, filters and structures that differ.
    """

    block: Block
    fields: dict[str, Value]
    units: dict[str, str]
    settings: Settings
    notes: tuple[str, ...]


def fields_of(block: Block, settings: Settings, ranges: Ranges) -> dict[str, Value]:
    """Return a block's fields for the settings of a loop with these ranges, for a report.

    A remark on what the user must check stands under 'note'. Where the fields cannot be given, a span
    missing for instance, the reason stands under 'unavailable', alone: a gain in the wrong unit would
    be worse than none.
    """
    try:
        pv_span = _span(ranges.pv_low, ranges.pv_high)
        op_span = _span(ranges.op_low, ranges.op_high)
        plate = to_block(settings, block, pv_span=pv_span, op_span=op_span)
    except ValueError as reason:
        return {"unavailable": str(reason)}
    return plate.fields | ({"note": "; ".join(plate.notes)} if plate.notes else {})


def to_block(
    settings: Settings, block: Block, *, pv_span: float | None = None, op_span: float | None = None
) -> Faceplate:
    """Fields of a block for the settings.

    Parameters
    ----------
    settings
        Scalar settings in any form, engineering units.
    block
        The block (`find_block`).
    pv_span, op_span
        Ranges of PV [PV] and OP [OP]; needed where the block counts in per cent of them.

    Returns
    -------
    Faceplate
        With the settings that the block really has, for a check.

    Raises
    ------
    NotRepresentableError
        Where the block's form cannot hold the settings, or how it switches its integral off is not known.
    ValueError
        Where a span is missing, or the gain is 0.

    Examples
    --------
    >>> from tuners.blocks import find_block
    >>> settings = Settings(kp=2.5, ti=32.0, td=3.0, tf=0.3, form="series")
    >>> plate = to_block(settings, find_block("provox-pid"), pv_span=100.0, op_span=100.0)
    >>> [f"{name} = {plate.fields[name]:.4g} {plate.units[name]}" for name in ("GAIN", "RESET", "RATE")]
    ['GAIN = 2.5 %/%', 'RESET = 1.875 repeats/min', 'RATE = 0.05 min']
    """
    if settings.kp == 0 or not math.isfinite(settings.kp):
        raise ValueError(f"kp = {settings.kp}: must be a finite number other than 0 [OP/PV]")
    own = _in_own_form(settings, block)
    notes = [] if block.verified else [f"{block.name}: not verified, check units and form against its manual"]
    notes += [block.note] if block.note else []
    gain = abs(float(own.kp)) * _span_ratio(block, pv_span, op_span)
    fields: dict[str, Value] = {}
    units: dict[str, str] = {}
    if block.form_field:
        fields[block.form_field] = block.form_values[own.form]
    fields |= block.constants
    sign = 1.0 if block.action else math.copysign(1.0, float(own.kp))
    fields[block.gain] = sign * (100 / gain if block.gain_unit == "pb" else gain) / block.gain_scale
    units[block.gain] = _gain_unit(block)
    fields[block.integral] = _integral_field(own, block, gain)
    units[block.integral] = _integral_unit(block, own.form)
    td = float(own.td) * (gain if _gains(block, own.form) else 1.0)
    fields[block.derivative] = td / TIME_UNITS[block.derivative_unit] / block.derivative_scale
    units[block.derivative] = _counts(block.derivative_scale, block.derivative_unit)
    _write_filter(own, block, fields, units, notes)
    _write_weights(settings, block, fields, notes)
    if block.action:
        fields[block.action] = block.reverse if own.kp > 0 else block.direct
    actual = from_block(fields, block, pv_span=pv_span, op_span=op_span)
    return Faceplate(block, fields, units, actual, tuple(notes))


def from_block(
    fields: Mapping[str, Value], block: Block, *, pv_span: float | None = None, op_span: float | None = None
) -> Settings:
    """Read the settings behind the fields of a block; the inverse of `to_block`.

    Parameters
    ----------
    fields
        Field values by name; choices that are left out take the block's default (reverse acting, first
        form and structure), a filter that is not known is taken as td/10.
    block
        The block (`find_block`).
    pv_span, op_span
        Ranges of PV [PV] and OP [OP]; needed where the block counts in per cent of them.

    Returns
    -------
    Settings
        In the block's form, engineering units.

    Raises
    ------
    ValueError
        Where gain, integral or derivative is missing or not a number, a choice is unknown, a span is
        missing, or the block has its gain or band at 0.

    Examples
    --------
    >>> from tuners.blocks import find_block
    >>> fields = {"GAIN": 2.5, "RESET": 1.875, "RATE": 0.05, "ACTION": "REVERSE"}
    >>> settings = from_block(fields, find_block("provox-pid"), pv_span=100.0, op_span=100.0)
    >>> settings.kp, settings.ti, settings.td
    (2.5, 32.0, 3.0)
    """
    form = _chosen_form(fields, block)
    shown = _number(fields, block.gain) * block.gain_scale
    if shown == 0:
        raise ValueError(f"{block.gain} = 0: must not be 0")
    gain = 100 / shown if block.gain_unit == "pb" else shown
    td = _number(fields, block.derivative) * block.derivative_scale * TIME_UNITS[block.derivative_unit]
    ti = _integral_time(_number(fields, block.integral), block, form, abs(gain))
    if _gains(block, form):
        td /= abs(gain)
    if block.action and _choice(fields, block.action, (block.reverse, block.direct)) == block.direct:
        gain = -gain
    b, c = _weights(fields, block)
    kp = gain / _span_ratio(block, pv_span, op_span)
    return Settings(kp, ti, td, _filter_time(fields, block, td), form, b, c)


def _in_own_form(settings: Settings, block: Block) -> Settings:
    """Return the settings in their own form if the block has it, else in the first that can hold them."""
    candidates = [settings.form] if settings.form in block.forms else block.forms
    reasons = []
    for form in candidates:
        try:
            return settings.to(form)
        except NotRepresentableError as reason:
            reasons.append(str(reason))
    raise NotRepresentableError(f"{block.name}: {reasons[0]}")


def _span_ratio(block: Block, pv_span: float | None, op_span: float | None) -> float:
    """Factor from OP/PV to the block's gain unit."""
    if block.basis == "engineering":
        return 1.0
    for name, span in (("pv_span", pv_span), ("op_span", op_span)):
        if span is None:
            raise ValueError(f"{name}: {block.name} counts in % of the spans, give both")
        if not 0 < span < math.inf:
            raise ValueError(f"{name} = {span}: must be above 0")
    return float(pv_span or 1.0) / float(op_span or 1.0)


def _gains(block: Block, form: str) -> bool:
    """Whether integral and derivative fields are gains (parallel) rather than times."""
    return form == "parallel" and not block.times


def _integral_field(own: Settings, block: Block, gain: float) -> float:
    """Value of the integral field."""
    rate = block.integral_unit in RATE_UNITS
    if math.isinf(own.ti):
        if block.integral_off is None and not rate:
            raise NotRepresentableError(
                f"{block.name}: no value of {block.integral} is known to switch integral action off"
            )
        return 0.0 if block.integral_off is None else block.integral_off
    if rate:
        repeats = RATE_UNITS[block.integral_unit] / float(own.ti)
        return repeats * (gain if _gains(block, own.form) else 1.0) / block.integral_scale
    return float(own.ti) / TIME_UNITS[block.integral_unit] / block.integral_scale


def _integral_time(shown: float, block: Block, form: str, gain: float) -> float:
    """Integral time [s] behind the integral field; inf where it is switched off."""
    if shown == block.integral_off or (shown == 0 and block.integral_unit in RATE_UNITS):
        return math.inf
    if shown <= 0:
        raise ValueError(f"{block.integral} = {shown:g}: must be above 0")
    shown *= block.integral_scale
    if block.integral_unit in RATE_UNITS:
        return RATE_UNITS[block.integral_unit] / shown * (gain if _gains(block, form) else 1.0)
    return shown * TIME_UNITS[block.integral_unit]


def _write_filter(
    own: Settings, block: Block, fields: dict[str, Value], units: dict[str, str], notes: list[str]
) -> None:
    """Add the filter field, or a note where the block has none for it."""
    td, tf = float(own.td), float(own.filter_time)
    if td == 0:
        return
    if not block.filter:
        ratio = 1 / FILTER_RATIO if block.filter_ratio is None else block.filter_ratio
        known = "not known here, assumed" if block.filter_ratio is None else "fixed"
        if block.filter_ratio is None or not math.isclose(tf, ratio * td, rel_tol=1e-6):
            notes.append(f"derivative filter of the block: {known} at tf = {ratio:g} td")
        return
    value = _filter_value(block, td, tf)
    if block.filter_range and not block.filter_range[0] <= value <= block.filter_range[1]:
        low, high = block.filter_range
        notes.append(
            f"{block.filter} = {value:.4g} lies outside {low:g} to {high:g} and was set to the limit"
        )
        value = min(max(value, low), high)
    fields[block.filter] = value
    units[block.filter] = block.filter_unit if block.filter_unit in TIME_UNITS else ""


def _filter_value(block: Block, td: float, tf: float) -> float:
    if block.filter_unit == "ratio":
        return tf / td
    if block.filter_unit == "gain":
        if tf == 0:
            raise NotRepresentableError(f"{block.name}: {block.filter} = td/tf cannot express tf = 0")
        return td / tf
    return tf / TIME_UNITS[block.filter_unit]


def _filter_time(fields: Mapping[str, Value], block: Block, td: float) -> float:
    """Filter time [s] behind the fields."""
    if td == 0:
        return 0.0
    if not block.filter or block.filter not in fields:
        return td / FILTER_RATIO if block.filter_ratio is None else td * block.filter_ratio
    shown = _number(fields, block.filter)
    if block.filter_unit == "ratio":
        return td * shown
    if block.filter_unit == "gain":
        return td / shown
    return shown * TIME_UNITS[block.filter_unit]


def _write_weights(settings: Settings, block: Block, fields: dict[str, Value], notes: list[str]) -> None:
    """Add the set-point structure that comes nearest to the settings' weights."""
    wanted = [float(settings.b), float(settings.c)]
    if block.b_field:
        fields[block.b_field] = wanted[0]
    if block.c_field:
        fields[block.c_field] = wanted[1]
    if block.structures:
        name = min(block.structures, key=lambda key: math.dist(block.structures[key], wanted))
        fields[block.structure_field or "structure"] = name
        held = block.structures[name]
    else:
        held = [wanted[0] if block.b_field else 1.0, wanted[1] if block.c_field else 1.0]
    if math.dist(held, wanted) > 1e-9 and (settings.td != 0 or held[0] != wanted[0]):
        notes.append(f"set-point weights of the block: b = {held[0]:g}, c = {held[1]:g}")


def _weights(fields: Mapping[str, Value], block: Block) -> tuple[float, float]:
    b, c = 1.0, 1.0
    if block.structures:
        choices = tuple(block.structures)
        b, c = block.structures[_choice(fields, block.structure_field or "structure", choices)]
    if block.b_field in fields:
        b = _number(fields, block.b_field)
    if block.c_field in fields:
        c = _number(fields, block.c_field)
    return float(b), float(c)


def _chosen_form(fields: Mapping[str, Value], block: Block) -> str:
    if not block.form_field:
        return block.forms[0]
    names = {value: form for form, value in block.form_values.items()}
    default = block.form_values[block.forms[0]]
    ordered = (default, *(name for name in names if name != default))
    return names[_choice(fields, block.form_field, ordered)]


def _choice(fields: Mapping[str, Value], name: str, accepted: tuple[str, ...]) -> str:
    """Value of a field with choices; the first choice where it is left out."""
    value = str(fields.get(name, accepted[0]))
    if value not in accepted:
        raise ValueError(f"{name} = {value!r}: must be one of {', '.join(accepted)}")
    return value


def _number(fields: Mapping[str, Value], name: str) -> float:
    if name not in fields:
        raise ValueError(f"{name}: missing")
    try:
        value = float(fields[name])
    except ValueError:
        value = math.nan
    if math.isnan(value):
        raise ValueError(f"{name} = {fields[name]!r}: must be a number")
    return value


def _counts(scale: float, unit: str) -> str:
    return unit if scale == 1 else f"{scale:g} {unit}".strip()


def _gain_unit(block: Block) -> str:
    if block.gain_unit == "pb":
        return "%"
    return _counts(block.gain_scale, "%/%" if block.basis == "percent" else "OP/PV")


def _integral_unit(block: Block, form: str) -> str:
    if block.integral_unit in RATE_UNITS:
        unit = block.integral_unit if _gains(block, form) else f"repeats/{block.integral_unit[2:]}"
    else:
        unit = f"{block.integral_unit}/repeat"
    return _counts(block.integral_scale, unit)
