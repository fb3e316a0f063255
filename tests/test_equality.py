"""A record that holds an array is compared by identity: by value, `==` would ask whether an array is true."""

from __future__ import annotations

import importlib
import inspect
import pkgutil
import typing
from collections.abc import Iterator
from dataclasses import dataclass, fields, is_dataclass
from types import ModuleType, UnionType

import numpy as np
import pytest


def modules() -> Iterator[ModuleType]:
    """Every module of ours."""
    for name in ("tuners", "monitor", "sim_plants"):
        package = importlib.import_module(name)
        yield package
        for found in pkgutil.walk_packages(package.__path__, f"{name}."):
            if not found.name.endswith("__main__"):
                yield importlib.import_module(found.name)


def is_array(hint: object) -> bool:
    """Whether a field of this type holds an array whenever it is not None; ``float | array`` may be a number."""
    if typing.get_origin(hint) in (typing.Union, UnionType):
        return all(is_array(h) or h is type(None) for h in typing.get_args(hint))
    if hint is np.ndarray or typing.get_origin(hint) is np.ndarray:
        return True
    return any(is_array(h) for h in typing.get_args(hint))


def by_value_with_arrays(classes: dict[str, type]) -> list[str]:
    """Names of the dataclasses that hold arrays and are compared by value."""
    wrong = []
    for name, cls in classes.items():
        if is_dataclass(cls) and cls.__eq__ is not object.__eq__:
            hints = typing.get_type_hints(cls, localns={c.__name__: c for c in classes.values()})
            if any(is_array(hints[f.name]) for f in fields(cls)):
                wrong.append(name)
    return wrong


def test_records_with_arrays_are_compared_by_identity():
    classes = {
        f"{module.__name__}.{name}": cls
        for module in modules()
        for name, cls in inspect.getmembers(module, inspect.isclass)
        if cls.__module__ == module.__name__
    }
    assert sum(is_dataclass(c) for c in classes.values()) > 50
    assert by_value_with_arrays(classes) == []


@dataclass(frozen=True)
class Whole:
    """A record with an array, as it should not be."""

    values: np.ndarray | None


@dataclass(frozen=True)
class Either:
    """A number, or an array of them: compared where it is a number."""

    value: float | np.ndarray


@pytest.mark.parametrize(("cls", "wrong"), [(Whole, True), (Either, False)])
def test_the_rule_itself(cls, wrong):
    assert bool(by_value_with_arrays({cls.__name__: cls})) is wrong
