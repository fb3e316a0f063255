"""Plant files: what they give, and how each mistake is named."""

import textwrap

import pytest

from sim_plants import plantfile
from sim_plants.controllers import Controller
from sim_plants.loops import LoopSpec, Steps
from sim_plants.plantfile import PlantFileError, load_plant_file
from sim_plants.plants import Plant

GOOD = """
[[loop]]
name = "LIC-101"
process = "integrating"
gain = -0.02
dead_time = 4.5
lags = [3, 1.0]
kp = -2.5
ti = 60
op_low = 0
op_high = 100
op0 = 40
noise = 0.05
setpoint = { times = [100, 700], sizes = [2.0, -2], repeat = 1200 }

[[loop]]
name = "TIC-1"
process = "self-regulating"
gain = 2.0
lags = [30.0]
form = "parallel"
kp = 1.5
ki = 0.05
kd = 3.0
auto = false
"""


def test_a_plant_file_gives_its_loops(tmp_path):
    path = tmp_path / "plant.toml"
    path.write_text(GOOD)
    first, second = load_plant_file(path)
    assert first == LoopSpec(
        "LIC-101",
        Plant("integrating", -0.02, 4.5, (3.0, 1.0)),
        Controller(-2.5, 60.0, op_low=0.0, op_high=100.0),
        op0=40.0,
        noise=0.05,
        setpoint=Steps((100.0, 700.0), (2.0, -2.0), 1200.0),
    )
    assert second.controller == Controller(1.5, 1.5 / 0.05, 2.0, form="parallel")
    assert second.auto is False


def test_the_plant_file_of_the_docstring_is_one(tmp_path):
    path = tmp_path / "plant.toml"
    path.write_text(textwrap.dedent(plantfile.__doc__.split("::\n\n")[1]))
    (loop,) = load_plant_file(path)
    assert loop.plant == Plant("integrating", -0.02, 4.5, (3.0, 1.0))


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("gain = -0.02", "gain = 0", "loop 1 (LIC-101): gain: 0.0, expected a finite number other than 0"),
        ("gain = -0.02", 'gain = "x"', "loop 1 (LIC-101): gain: 'x', expected a number"),
        ("gain = -0.02", "", "loop 1 (LIC-101): gain: missing, expected a value"),
        ("kp = -2.5", "kq = -2.5", "loop 1 (LIC-101): kp: missing, expected a value"),
        ("noise = 0.05", "noize = 0.05", "loop 1 (LIC-101): noize: unknown, expected one of name, pv0"),
        ("noise = 0.05", "noise = -1", "loop 1 (LIC-101): noise: -1.0, expected a number, 0 or more"),
        ("noise = 0.05", "seed = 1.5", "loop 1 (LIC-101): seed: 1.5, expected a whole number"),
        ("lags = [3, 1.0]", "lags = 3", "loop 1 (LIC-101): lags: 3, expected a list of numbers"),
        ("repeat = 1200", "repeat = 5", "loop 1 (LIC-101): setpoint.repeat: 5.0, expected seconds above"),
        ("repeat = 1200", "every = 5", "loop 1 (LIC-101): setpoint.every: unknown, expected one of times"),
        ("op0 = 40", "setpoint = 3", "Cannot overwrite a value"),
        ("op0 = 40", "load = 3", "loop 1 (LIC-101): load: 3, expected a table with times"),
        ("auto = false", 'auto = "no"', "loop 2 (TIC-1): auto: 'no', expected true or false"),
        ("ki = 0.05", "ki = -0.05", "loop 2 (TIC-1): ki: -0.05, expected the sign of kp (1.5)"),
        ('form = "parallel"', "", 'loop 2 (TIC-1): ki: 0.05, expected only with form = "parallel"'),
        ('"TIC-1"', '"LIC-101"', "loop 2 (LIC-101): name: 'LIC-101', expected a name that no other loop has"),
        ("[[loop]]\nname", "title = 1\n[[loop]]\nname", "title: expected tables [[loop]] only"),
    ],
)
def test_a_bad_plant_file_is_refused_in_one_line(tmp_path, old, new, message):
    path = tmp_path / "plant.toml"
    path.write_text(GOOD.replace(old, new, 1))
    with pytest.raises(PlantFileError) as caught:
        load_plant_file(path)
    assert any(problem.startswith(f"{path}: ") and message in problem for problem in caught.value.problems)
    assert all("\n" not in problem for problem in caught.value.problems)


@pytest.mark.parametrize("content", ["", "loop = 3", "[[", "loop = []", "[loop]\nname = 'x'"])
def test_a_file_without_loops_is_refused(tmp_path, content):
    path = tmp_path / "plant.toml"
    path.write_text(content)
    with pytest.raises(PlantFileError, match=r"plant\.toml: "):
        load_plant_file(path)


def test_all_problems_are_named_at_once(tmp_path):
    path = tmp_path / "plant.toml"
    path.write_text(GOOD.replace("gain = -0.02", "gain = 0").replace("gain = 2.0", "gain = true"))
    with pytest.raises(PlantFileError) as caught:
        load_plant_file(path)
    assert len(caught.value.problems) == 2
