"""Every example in a docstring gives what it says it gives."""

from __future__ import annotations

import doctest
import importlib
from pathlib import Path

import pytest

from tests.support.places import ROOT
from tuners.rules import RULES

FLAGS = doctest.NORMALIZE_WHITESPACE | doctest.ELLIPSIS


def modules() -> list[str]:
    """Modules of ours with an example in them."""
    files = [f for package in ("tuners", "monitor", "sim_plants") for f in (ROOT / package).rglob("*.py")]
    with_one = sorted(f for f in files if ">>> " in f.read_text(encoding="utf-8"))
    return [".".join(f.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__") for f in with_one]


@pytest.mark.parametrize("name", modules())
def test_examples(name):
    """All examples of a module are run, in the module's own names."""
    module = importlib.import_module(name)
    text = Path(str(module.__file__)).read_text(encoding="utf-8")
    tests = doctest.DocTestFinder(exclude_empty=True).find(module)
    assert sum(len(test.examples) for test in tests) == text.count(">>> ")  # none is overlooked
    runner = doctest.DocTestRunner(optionflags=FLAGS)
    said: list[str] = []
    for test in tests:
        runner.run(test, out=said.append)
    assert not runner.failures, "".join(said)


@pytest.mark.parametrize("name", RULES)
def test_every_tuning_rule_has_an_example(name):
    """A rule's docstring shows what it gives for a model."""
    assert ">>> " in str(RULES[name].function.__doc__)
