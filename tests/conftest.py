"""What holds for all tests: Hypothesis draws anew each time, but the same in CI, and without a deadline anywhere."""

from __future__ import annotations

import os

from hypothesis import HealthCheck, settings

COMMON = {"deadline": None, "suppress_health_check": [HealthCheck.too_slow]}  # a busy machine is no failure

settings.register_profile("random", **COMMON)
settings.register_profile("repeatable", **COMMON, derandomize=True, database=None)
settings.load_profile("repeatable" if os.environ.get("CI") else "random")
