"""A benchmark's fleets, judged in several processes, and what is written of them."""

from __future__ import annotations

import json
import multiprocessing
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict
from typing import Any


def judged(
    judge_many: Callable[..., list[Any]], names: Sequence[str], loops: int, chunk: int, jobs: int, *args: int
) -> Iterator[tuple[str, list[Any]]]:
    """Yield each name with the outcomes of its ``loops``, in order; ``args`` go to ``judge_many`` after the numbers."""
    with ProcessPoolExecutor(jobs, mp_context=multiprocessing.get_context("spawn")) as pool:
        waiting = {
            name: [
                pool.submit(judge_many, name, range(k, min(k + chunk, loops)), *args)
                for k in range(0, loops, chunk)
            ]
            for name in names
        }
        for name, parts in waiting.items():
            yield name, [outcome for part in parts for outcome in part.result()]


def write(outcomes: Iterable[Any], path: str) -> None:
    """Write outcomes (dataclasses) as JSON, one line each."""
    with open(path, "w", encoding="utf-8") as file:  # noqa: PTH123
        file.writelines(json.dumps(asdict(o), default=str) + "\n" for o in outcomes)
