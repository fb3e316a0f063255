"""A tuning rule on a model: settings, how safe they are, what they will do, and what to type into the block.

python examples/tuning_rule_on_model.py
"""

from __future__ import annotations

from tuners.blocks import BLOCKS
from tuners.faceplate import to_block
from tuners.models import IntegratingModel
from tuners.responses import step_figures
from tuners.robustness import margins
from tuners.rules import RULES

MODEL = IntegratingModel(gain=0.05, dead_time=4.0, lag=3.0)
"""A level: PV moves by 0.05 a second for each unit of OP, 4 s late, with a lag of 3 s."""
WANTED = ("simc-pid", "simc-pi", "tyreus-luyben", "ziegler-nichols")

if __name__ == "__main__":
    for name in WANTED:
        rule = RULES[name]
        settings = rule.function(MODEL)
        safe = margins(MODEL, settings)
        after = step_figures(MODEL, settings)
        print(
            f"{name:<16} {rule.structure:<4} kp = {settings.kp:.3g}, ti = {settings.ti:.3g} s, td = {settings.td:.3g} s"
        )
        print(
            f"{'':<16} Ms = {safe.ms:.2f}, phase margin {safe.phase_margin:.0f} degrees, "
            f"overshoot {after.overshoot[0]:.0%}, IAE after a load step {after.iae_load[0]:.3g}"
        )

    # the same settings as a DeltaV block shows them: its own form, its own units
    plate = to_block(RULES["simc-pid"].function(MODEL), BLOCKS["deltav-pid"], pv_span=100.0, op_span=100.0)
    for field, value in plate.fields.items():
        shown = f"{value:.4g}" if isinstance(value, float) else value
        print(f"  {field} = {shown} {plate.units.get(field, '')}".rstrip())
