"""How each kind of loop looks: colours that colour-blind eyes tell apart (Okabe and Ito 2008), and a shape each."""

from __future__ import annotations

from typing import NamedTuple

from monitor.contract.changes import BETTER, MISSING, MIXED, NEW, SAME, UNCLEAR, WORSE


class Look(NamedTuple):
    """Words, colour and shape of a kind."""

    words: str
    colour: str
    shape: str
    """SVG path about the origin, some 10 wide."""
    says: str


LOOKS: dict[str, Look] = {
    "good": Look("good", "#009e73", "M-4,0A4,4 0 1 0 4,0A4,4 0 1 0 -4,0Z", "fast enough and safe enough"),
    "retune": Look(
        "to retune", "#d55e00", "M0,-6L5.5,4.5L-5.5,4.5Z", "badly tuned, on evidence that can be trusted"
    ),
    "valve": Look("valve", "#0072b2", "M-4.5,-4.5H4.5V4.5H-4.5Z", "valve or actuator first, tuning after it"),
    "oscillating": Look(
        "oscillating", "#cc79a7", "M0,-6L6,0L0,6L-6,0Z", "a cycle to be traced before the tuning"
    ),
    "manual": Look(
        "in manual", "#e69f00", "M-5,-2H-2V-5H2V-2H5V2H2V5H-2V2H-5Z", "not controlled while in manual"
    ),
    "unclear": Look(
        "cannot tell",
        "#6b7280",
        "M-5,-3.2L-3.2,-5L0,-1.8L3.2,-5L5,-3.2L1.8,0L5,3.2L3.2,5L0,1.8L-3.2,5L-5,3.2L-1.8,0Z",
        "the data do not carry a verdict",
    ),
}
"""By kind."""

OUTCOME_LOOKS: dict[str, Look] = {
    WORSE: Look(
        "worse", "#d55e00", "M0,6L5.5,-4.5L-5.5,-4.5Z", "slower, nearer to instability, or a fault has come"
    ),
    MIXED: Look("both", "#e69f00", LOOKS["oscillating"].shape, "better in one figure, worse in another"),
    BETTER: Look("better", "#009e73", LOOKS["retune"].shape, "faster, safer, or a fault is gone"),
    UNCLEAR: LOOKS["unclear"]._replace(says="too few events, or more scatter than change"),
    SAME: Look("as before", "#0072b2", LOOKS["good"].shape, "what can be told has not changed"),
    NEW: Look("new", "#7b4f9d", LOOKS["manual"].shape, "not in the earlier audit"),
    MISSING: Look("missing", "#1b2430", LOOKS["valve"].shape, "not in the later audit"),
}
"""By outcome of a comparison: what points down is worse, what points up is better."""
