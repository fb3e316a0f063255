"""How the hot loops are compiled."""

from __future__ import annotations

from typing import Any

import numba

jit: Any = numba.njit(cache=True, error_model="numpy")
"""Compiled, cached on disk; 0/0 is NaN as in NumPy."""
