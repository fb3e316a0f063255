"""Command `loopsight tune`: what it prints, and one line for whatever is wrong."""

import builtins
import json
import math
import subprocess
import sys

import pytest
from click.testing import CliRunner

from monitor.cli.tune import EPILOG, tune
from tuners.blocks import BLOCKS, find_block
from tuners.faceplate import from_block
from tuners.models import IntegratingModel, SelfRegulatingModel
from tuners.responses import closed_loop_response
from tuners.robustness import margins
from tuners.rules import RULES
from tuners.settings import Settings
from tuners.suggest import suggest

MODEL = ["--gain", "-0.05", "--dead-time", "6", "--lag", "3"]
KEYS = (
    "rule", "form", "kp", "ti", "td", "tf", "ms", "gain_margin", "phase_margin", "delay_margin", "iae_setpoint",
    "iae_load", "source",
)  # fmt: skip


def run(*arguments):
    return CliRunner().invoke(tune, [str(a) for a in arguments])


def run_json(*arguments):
    found = run(*arguments, "--json")
    assert found.exit_code == 0, found.output
    return json.loads(found.stdout, parse_constant=lambda name: pytest.fail(f"JSON holds {name}"))


def test_json_of_one_rule_is_an_object_with_the_agreed_keys():
    row = run_json("--rule", "simc-pid", *MODEL)
    assert set(KEYS) <= set(row)
    model = IntegratingModel(-0.05, 6.0, 3.0)
    settings = Settings(row["kp"], row["ti"], row["td"], row["tf"], row["form"])
    assert (row["kp"], row["ti"], row["td"], row["form"]) == pytest.approx((-1 / 0.6, 48.0, 3.0, "series"))
    found = margins(model, settings)
    for key in ("ms", "gain_margin", "phase_margin", "delay_margin"):
        assert row[key] == pytest.approx(getattr(found, key))
    assert row["iae_setpoint"] == pytest.approx(closed_loop_response(model, settings).iae)
    assert row["iae_load"] == pytest.approx(closed_loop_response(model, settings, "load").iae)


def test_no_integral_action_is_null():
    row = run_json("--rule", "simc-pd", *MODEL)
    assert row["ti"] is None
    assert row["iae_load"] is None


def test_json_of_all_is_a_list_and_names_what_was_skipped():
    found = run("--rule", "all", *MODEL, "--json")
    rows = json.loads(found.stdout)
    skipped = {line.split()[1].rstrip(":") for line in found.stderr.splitlines()}
    assert {row["rule"] for row in rows} | skipped == set(RULES)
    assert "averaging" in skipped
    assert "max-load, max-deviation: must be given" in found.stderr


@pytest.mark.parametrize("process", ["integrating", "self-regulating"])
def test_every_rule_is_reachable(process):
    extra = ["--max-load", 10, "--max-deviation", 5, "--process", process]
    for name, rule in RULES.items():
        found = run("--rule", name, "--gain", 0.05, "--dead-time", 6, "--lag", 8, *extra, "--json")
        assert (found.exit_code == 0) == (process in rule.processes), found.output


def test_table_lists_every_rule_sorted_by_the_chosen_column():
    found = run("--rule", "all", *MODEL, "--sort", "ms")
    assert found.exit_code == 0
    lines = [line for line in found.stdout.splitlines() if line.split() and line.split()[0] in RULES]
    values = [float(line.split()[6]) for line in lines]
    assert len(values) > 20
    assert values == sorted(values)
    assert "skipped cohen-coon: process = integrating" in found.stdout


def test_unstable_rows_are_marked():
    """Shinskey's rule on a model that is all lag: half of it as dead time is not enough."""
    rows, *_ = suggest("ziegler-nichols-step", IntegratingModel(1.0, 1.0, 40.0))
    assert rows[0]["stable"] == (rows[0]["ms"] is not None)
    found = run("--rule", "imc-pid", "--gain", 1, "--dead-time", 1, "--lag", 60, "--closed-loop-time", 0.3)
    assert "imc-pid (unstable)" in found.stdout
    row = run_json("--rule", "imc-pid", "--gain", 1, "--dead-time", 1, "--lag", 60, "--closed-loop-time", 0.3)
    assert row["ms"] is row["gain_margin"] is row["iae_load"] is None


@pytest.mark.parametrize("form", ["standard", "series", "parallel"])
def test_form(form):
    row = run_json("--rule", "simc-pid", *MODEL, "--form", form)
    assert row["form"] == form
    own = Settings(-1 / 0.6, 48.0, 3.0, 0.3, "series").to(form)
    assert (row["kp"], row["ti"], row["td"], row["tf"]) == pytest.approx((own.kp, own.ti, own.td, own.tf))
    if form == "parallel":
        assert (row["ki"], row["kd"]) == pytest.approx((own.ki, own.kd))


@pytest.mark.parametrize("name", BLOCKS)
def test_block(name):
    """The fields on the faceplate, read back, are the settings that were judged."""
    row = run_json("--rule", "simc-pid", *MODEL, "--block", name, "--pv-span", 5, "--op-span", 100)
    block = find_block(name)
    back = from_block(row["fields"], block, pv_span=5, op_span=100)
    assert (back.kp, back.ti, back.td, back.form) == pytest.approx(
        (row["kp"], row["ti"], row["td"], row["form"])
    )
    text = run("--rule", "simc-pid", *MODEL, "--block", name).stdout
    assert f"{block.gain} = " in text
    assert ("not verified" in text) == (not block.verified)


def test_parameters_reach_their_rule():
    row = run_json("--rule", "di-ruscio", "--gain", 1, "--dead-time", 1, "--delta", 1.59, "--c", 4)
    assert row["kp"] == pytest.approx(0.5, rel=1e-3)
    row = run_json("--rule", "averaging", *MODEL, "--max-load", 10, "--max-deviation", 5)
    assert row["kp"] == pytest.approx(-2)
    row = run_json("--rule", "simc-pi", "--gain", 1, "--dead-time", 1, "--closed-loop-time", 3)
    assert row["kp"] == pytest.approx(0.25)


WRONG = {
    "no rule": (["--gain", 1, "--dead-time", 1], "rule = None: must be all or one of simc-pi"),
    "unknown rule": (["--rule", "simc", *MODEL], "rule = 'simc': must be all or one of simc-pi"),
    "no gain": (["--rule", "simc-pi", "--dead-time", 1], "gain = None: must be given"),
    "gain 0": (
        ["--rule", "simc-pi", "--gain", 0, "--dead-time", 1],
        "gain = 0: must be a finite number other",
    ),
    "gain nan": (
        ["--rule", "simc-pi", "--gain", "nan", "--dead-time", 1],
        "gain = nan: must be a finite number",
    ),
    "gain word": (["--rule", "simc-pi", "--gain", "big", "--dead-time", 1], "'big' is not a valid float"),
    "dead time": (
        ["--rule", "simc-pi", "--gain", 1, "--dead-time", -1],
        "dead_time = -1: must be a finite time",
    ),
    "no dead time": (["--rule", "simc-pi", "--gain", 1], "dead-time = None: must be given"),
    "zero dead time": (
        ["--rule", "simc-pi", "--gain", 1, "--dead-time", 0],
        "closed_loop_time: must be given",
    ),
    "lag": (
        ["--rule", "simc-pi", "--gain", 1, "--dead-time", 1, "--lag", -2],
        "lag = -2: must be a finite time",
    ),
    "process": (
        ["--rule", "simc-pi", *MODEL, "--process", "batch"],
        "must be integrating or self-regulating",
    ),
    "kind": (["--rule", "cohen-coon", *MODEL], "this rule is for self-regulating processes"),
    "form": (["--rule", "simc-pi", *MODEL, "--form", "ideal"], "must be one of standard, series, parallel"),
    "block": (["--rule", "simc-pi", *MODEL, "--block", "abc"], "block = 'abc': must be one of deltav-pid"),
    "both": (["--rule", "simc-pi", *MODEL, "--block", "x", "--form", "series"], "give one of them"),
    "series": (["--rule", "ziegler-nichols", *MODEL, "--form", "series"], "ti must be at least"),
    "time": (
        ["--rule", "simc-pi", *MODEL, "--closed-loop-time", 0],
        "closed_loop_time = 0.0: must be above 0",
    ),
    "sort": (["--rule", "all", *MODEL, "--sort", "beauty"], "sort = 'beauty': must be one of rule, kp"),
    "plot": (["--rule", "simc-pi", *MODEL, "--plot", "a.gif"], "must end in .png or .svg"),
    "folder": (["--rule", "simc-pi", *MODEL, "--plot", "/no/such/a.png"], "cannot be written"),
    "missing": (["--rule", "averaging", *MODEL], "max-load, max-deviation: must be given"),
    "span": (
        ["--rule", "simc-pi", *MODEL, "--block", "deltav-pid", "--pv-span", 0],
        "pv_span = 0.0: must be above 0",
    ),
    "option": (["--rule", "simc-pi", *MODEL, "--fast"], "No such option"),
    "lag2": (["--rule", "simc-pi", *MODEL, "--lag2", 2], "lag2 = 2: is for self-regulating"),
}


@pytest.mark.parametrize("name", WRONG)
def test_wrong_input_is_one_line_on_stderr_and_exit_2(name):
    arguments, text = WRONG[name]
    found = run(*arguments)
    assert found.exit_code == 2
    assert found.stdout == ""
    assert len(found.stderr.splitlines()) == 1
    assert text in found.stderr


@pytest.mark.parametrize("suffix", ["png", "svg"])
def test_plot(tmp_path, suffix):
    path = tmp_path / f"responses.{suffix}"
    found = run("--rule", "all", *MODEL, "--plot", path)
    assert found.exit_code == 0
    start = path.read_bytes()[:200]
    assert start.startswith(b"\x89PNG" if suffix == "png" else b"<?xml")


def test_plot_without_matplotlib_is_one_line(monkeypatch):
    real = builtins.__import__

    def refuse(name, *args, **kwargs):
        if name.startswith("matplotlib"):
            raise ImportError(name)
        return real(name, *args, **kwargs)

    monkeypatch.setattr(builtins, "__import__", refuse)
    for name in [name for name in sys.modules if name.startswith("matplotlib")]:
        monkeypatch.delitem(sys.modules, name)
    found = run("--rule", "simc-pi", *MODEL, "--plot", "a.png")
    assert (found.exit_code, found.stdout) == (2, "")
    assert found.stderr == "loopsight tune: plot: needs matplotlib, install loopsight[plot]\n"


def test_list_names_every_rule_with_its_source():
    text = run("--list").stdout
    for name, rule in RULES.items():
        assert f"{name}: {rule.structure}" in text
        assert rule.source in text
    assert {row["rule"] for row in json.loads(run("--list", "--json").stdout)} == set(RULES)
    for block in BLOCKS.values():
        assert f"block {block.id}: {block.name}" in text


def test_help_has_examples_that_run():
    found = run("--help")
    assert found.exit_code == 0
    assert "loopsight tune --rule simc-pi" in found.stdout
    joined = EPILOG.replace("\n                 ", " ")
    examples = [line.split()[2:] for line in joined.splitlines() if line.strip().startswith("loopsight")]
    assert len(examples) == 4
    for example in examples:
        assert run(*example).exit_code == 0


def test_version():
    assert run("--version").stdout.startswith("loopsight")


def test_help_imports_nothing_heavy():
    """Help must answer at once: neither numpy nor rich is imported for it."""
    code = (
        "import sys; from monitor.cli.tune import tune\n"
        "try: tune(['--help'])\n"
        "except SystemExit: pass\n"
        "bad = {'numpy', 'scipy', 'rich', 'matplotlib'} & set(sys.modules)\n"
        "sys.exit(f'imported {bad}' if bad else 0)"
    )
    done = subprocess.run([sys.executable, "-c", code], check=False, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def test_numbers_are_finite_or_null():
    rows, skipped, curves = suggest("all", SelfRegulatingModel(2.0, 5.0, 20.0))
    assert set(curves) == {row["rule"] for row in rows}
    assert skipped
    for row in rows:
        for value in row.values():
            assert not isinstance(value, float) or math.isfinite(value)


def test_relay_test_in_place_of_dead_time_and_lag():
    """Kaya 2018's first example: 1/(s (s + 1)) with a dead time of 3 s, under a relay of 1."""
    cycle = ["--relay-output", 1, "--relay-period", 15.9446, "--relay-amplitude", 3.2933]
    found = run("--rule", "simc-pid", *cycle, "--gain", 1, "--json")
    row = run_json("--rule", "simc-pid", "--gain", 1, "--dead-time", 3, "--lag", 1)
    assert json.loads(found.stdout)["kp"] == pytest.approx(row["kp"], rel=2e-3)
    assert found.stderr.startswith("relay test: gain 1 PV/(OP s), dead time 3")
    ipdt = run(
        "--rule", "simc-pi", "--relay-output", 1, "--relay-period", 16, "--relay-amplitude", 0.2, "--json"
    )
    assert json.loads(ipdt.stdout)["ti"] == 32.0


def test_a_relay_test_alone_compares_all_rules():
    """Period, amplitude and output are all that a user has after the test: no rule is asked for."""
    cycle = ["--relay-period", 16, "--relay-amplitude", 0.2, "--relay-output", 1]
    alone, every = run(*cycle, "--json"), run(*cycle, "--rule", "all", "--json")
    assert alone.exit_code == 0, alone.stderr
    assert json.loads(alone.stdout) == json.loads(every.stdout)
    assert {"simc-pi", "imc-pid"} <= {row["rule"] for row in json.loads(alone.stdout)}


@pytest.mark.parametrize(
    ("extra", "names"),
    [
        (["--relay-period", 16], "relay-output = None: must be given"),
        (
            ["--relay-period", 0, "--relay-output", 1, "--relay-amplitude", 1],
            "relay-period = 0.0: must be above 0",
        ),
        (
            ["--relay-period", 16, "--relay-output", 1, "--relay-amplitude", 1, "--dead-time", 3],
            "relay: shows",
        ),
        (["--relay-period", 16, "--relay-output", 1, "--relay-amplitude", 1, "--gain", 0], "gain = 0"),
        (
            ["--relay-period", 16, "--relay-output", 1, "--relay-amplitude", 9, "--gain", 1],
            "no lag explains it",
        ),
    ],
)
def test_relay_test_that_says_too_little_or_too_much(extra, names):
    found = run("--rule", "simc-pi", *extra)
    assert (found.exit_code, found.stderr.count("\n")) == (2, 1)
    assert names in found.stderr
