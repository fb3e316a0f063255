"""One contract for all health modules: sums halve, what ran is forgotten, and nothing else changes."""

from __future__ import annotations

from types import ModuleType
from typing import Any

import numpy as np
import pytest

from monitor.health import (
    autocorrelation,
    coverage,
    harris,
    level,
    measurement,
    offset,
    path,
    saturation,
    stiction,
    tag_mapping,
    travel,
)
from monitor.health.observe import HEALTH

MODULES = (
    *(autocorrelation, coverage, harris, level, measurement, offset, path, saturation, stiction, tag_mapping),
    travel,
)
INSIDE = {autocorrelation: level, level: stiction, travel: path}
"""Whose record stands in whose."""


def named(module: ModuleType) -> str:
    return module.__name__.rpartition(".")[2]


def filled(dtype: np.dtype[Any], seed: int = 0) -> Any:
    """A record of even numbers, all larger than zero: halving is exact."""
    rng = np.random.default_rng(seed)
    record = np.zeros(1, dtype)
    _fill(record, rng)
    return record[0]


def _fill(array: Any, rng: np.random.Generator) -> None:
    for name in array.dtype.names or ():
        if array[name].dtype.names is not None:
            _fill(array[name], rng)
        else:
            array[name] = 2 * rng.integers(1, 1000, array[name].shape)


def numbers(record: Any) -> dict[str, Any]:
    """The values of a record's own fields, copied."""
    return {n: np.array(record[n]) for n in record.dtype.names if record[n].dtype.names is None}


def changed(module: ModuleType, act: Any, group: list[Any], to: Any) -> None:
    """Acting on a record changes the fields of a group, and of that group in the records inside of it, and no other."""
    record = filled(module.DTYPE)
    before, inner = (
        numbers(record),
        {n: record[n].copy() for n in record.dtype.names if record[n].dtype.names},
    )
    act(record)
    own = {f[0] for f in group}
    for name, value in before.items():
        np.testing.assert_array_equal(record[name], to(value) if name in own else value, err_msg=name)
    for name, value in inner.items():
        inside = INSIDE[module]
        fields = {f[0] for f in (inside.SUMS if group is module.SUMS else inside.RUNNING)}
        for field in (n for n in value.dtype.names if value[n].dtype.names is None):
            expected = to(value[field]) if field in fields else value[field]
            np.testing.assert_array_equal(record[name][field], expected, err_msg=f"{name}.{field}")


@pytest.mark.parametrize("module", MODULES, ids=named)
def test_a_field_is_in_one_group(module):
    """So what becomes of it is said where it is declared."""
    groups = [f[0] for f in (*module.SUMS, *module.RUNNING, *module.KEPT)]
    assert groups == [n for n in module.DTYPE.names if module.DTYPE[n].base.names is None]


@pytest.mark.parametrize("module", [m for m in MODULES if m.SUMS], ids=named)
def test_decay_halves_every_sum_and_nothing_else(module):
    changed(module, module.decay, module.SUMS, lambda value: value / 2)


@pytest.mark.parametrize("module", [m for m in MODULES if m.RUNNING], ids=named)
def test_reset_forgets_what_ran_and_nothing_else(module):
    changed(module, module.reset, module.RUNNING, np.zeros_like)


@pytest.mark.parametrize("module", MODULES, ids=named)
def test_a_module_has_what_the_contract_asks_for(module):
    """And nothing that acts on an empty group."""
    assert hasattr(module, "update") or hasattr(module, "update_block")
    assert hasattr(module, "decay") == bool(module.SUMS)
    assert hasattr(module, "reset") == bool(module.RUNNING)


def test_the_loops_record_holds_each_modules_part():
    """Nested, each under its own name; what belongs to a module stands nowhere else."""
    parts = {n: HEALTH[n] for n in HEALTH.names or () if HEALTH[n].names}
    inside = {named(m) for m in INSIDE.values()}
    assert parts == {named(m): m.DTYPE for m in MODULES if named(m) not in inside}


def test_whole_numbers_are_rounded_down():
    """A class of amplitude counts in sixteen bits."""
    record = np.zeros(1, stiction.DTYPE)[0]
    record["times"] = 7
    stiction.decay(record)
    assert record["times"].tolist() == [3] * stiction.SIZE_CLASSES
