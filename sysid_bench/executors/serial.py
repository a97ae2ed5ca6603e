"""tasks -> rows, one after the other in this process."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import Any

from sysid_bench.nouns import Task


@dataclass(frozen=True)
class Serial:
    """Everything in this process: for debugging and for the smallest studies."""

    def run(
        self, work: Callable[[Task], Iterator[dict[str, Any]]], tasks: Iterable[Task]
    ) -> Iterator[dict[str, Any]]:
        for task in tasks:
            yield from work(task)
