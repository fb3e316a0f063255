"""How the hot loops are compiled, and kept on disk until a source that they rest on changes.

numba keeps a compiled function as long as the function's own file stays as it is. Ours call functions of other files,
and hold constants of them: after an update of one of these, numba alone would go on running what was compiled of the
old one. Here the kept function is known by its own file and by all of our files that this one imports from.
"""

from __future__ import annotations

import hashlib
import inspect
import re
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numba
from numba.core import caching

ROOT = Path(__file__).resolve().parent.parent
OURS = ("monitor", "tuners")
_IMPORT = re.compile(r"^from (\.*)([\w.]*) import (\([^)]*\)|.*)", re.MULTILINE)


@cache
def fingerprint(path: Path) -> str:
    """Return a hash of a source file and of all of ours that it imports from at its top, directly or by others.

    Raises
    ------
    OSError
        A file cannot be read.
    """
    found, new = {path}, [path]
    while new:
        _, imported = _read(new.pop())
        new += [p for p in imported if p not in found]
        found.update(imported)
    together = hashlib.sha256()
    for each in sorted(found):
        together.update(_read(each)[0])
    return together.hexdigest()


@cache
def _read(path: Path) -> tuple[bytes, tuple[Path, ...]]:
    """Return a file's own hash, and the files of ours that it imports from."""
    source = path.read_bytes()
    files: set[Path] = set()
    for dots, name, names in _IMPORT.findall(source.decode()):
        if dots or name.split(".")[0] in OURS:
            place = (path.parents[len(dots) - 1] if dots else ROOT).joinpath(*filter(None, name.split(".")))
            inside = (place / f"{word}.py" for word in re.findall(r"\w+", names))
            files.update((p for p in inside if p.is_file()) if place.is_dir() else [place.with_suffix(".py")])
    return hashlib.sha256(source).digest(), tuple(files)


class _Index(caching.IndexDataCacheFile):  # type: ignore[misc]
    """numba's index of what is kept, which names classes: one that is gone from the sources makes it an old one."""

    def _load_index(self) -> Any:
        try:
            return super()._load_index()
        except (AttributeError, ImportError):
            return {}  # nothing is kept: all is compiled anew


class _Kept(caching.FunctionCache):  # type: ignore[misc]  # numba has no types
    """numba's own way of keeping a function, which asks for the `fingerprint` too."""

    def __init__(self, function: Callable[..., Any]) -> None:
        super().__init__(function)
        locator = self._impl.locator
        stamp = locator.get_source_stamp(), fingerprint(Path(inspect.getfile(function)).resolve())
        self._cache_file = _Index(locator.get_cache_path(), self._impl.filename_base, stamp)


def _compiler(**options: Any) -> Any:
    """Return a decorator; where a numba has other inner parts, or sources are not files, numba's own cache serves."""
    decorate = numba.njit(error_model="numpy", **options)

    def compiled(function: Callable[..., Any]) -> Any:
        out = decorate(function)
        try:
            if isinstance(out._cache, caching.NullCache):  # noqa: SLF001 (numba takes a cache in no other way)
                out._cache = _Kept(function)  # noqa: SLF001
                return out
        except (OSError, ValueError, AttributeError, TypeError, RuntimeError):
            pass
        if hasattr(out, "enable_caching"):  # NUMBA_DISABLE_JIT leaves the function as it was
            out.enable_caching()
        return out

    return compiled


jit = _compiler()
"""Compiled, cached on disk; 0/0 is NaN as in NumPy."""
jit_inlined = _compiler(inline="always")
"""As `jit`, written out where it is called: for what each sample passes through once, where a call costs as much."""
jit_nogil = _compiler(nogil=True)
"""As `jit`; lets other threads run beside it."""
jit_sums = _compiler(fastmath={"reassoc", "contract"})
"""As `jit`; sums are taken in whatever order is fastest: some last digits of a long sum, several times its speed."""
unrolled: Any = numba.literal_unroll
"""A loop over names, written out when it is compiled: each name is a record's field of its own type."""
