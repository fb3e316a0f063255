"""What `monitor` hands out by itself, and that it costs nothing until asked for."""

from __future__ import annotations

import subprocess
import sys

import pytest

import monitor


@pytest.mark.parametrize("name", monitor.__all__)
def test_each_name_is_what_its_home_has(name):
    """A name from here is the same object as in its module, and completion knows it."""
    home = sys.modules[getattr(monitor, name).__module__]
    assert getattr(home, name) is getattr(monitor, name)
    assert name in dir(monitor)


def test_all_names_have_a_home():
    """The list for readers, and the one by which they are found, name the same."""
    assert sorted(monitor._HOMES) == monitor.__all__ == sorted(monitor.__all__)


def test_an_unknown_name_is_refused():
    with pytest.raises(AttributeError, match="has no attribute 'Motor'"):
        _ = monitor.Motor


def test_the_package_by_itself_imports_nothing_heavy():
    """`import monitor` is what every command begins with."""
    program = "import sys, monitor; print(sorted({'numpy', 'numba', 'pyarrow', 'click'} & set(sys.modules)))"
    found = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert found.stdout == "[]\n"
