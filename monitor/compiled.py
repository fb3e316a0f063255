"""How the monitor's hot loops are compiled: as those of `tuners`, kept on disk until a source they rest on changes."""

from __future__ import annotations

from tuners.compiled import fingerprint, jit, jit_inlined, jit_nogil, jit_sums, unrolled

__all__ = ["fingerprint", "jit", "jit_inlined", "jit_nogil", "jit_sums", "unrolled"]
