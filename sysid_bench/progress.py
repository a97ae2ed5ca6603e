"""counts -> a line that a person watches: a bar with rate and time left on a terminal, plain lines elsewhere."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager

LINE_EVERY_S = 10.0


class Lines:
    """Plain lines for logs: at most one every ten seconds."""

    def __init__(self, what: str, total: int) -> None:
        self.what, self.total, self.count, self.failures = what, total, 0, 0
        self.start = self.last = time.monotonic()

    def advance(self, failures: int = 0) -> None:
        self.count += 1
        self.failures += failures
        now = time.monotonic()
        if now - self.last >= LINE_EVERY_S:
            self.last = now
            rate = self.count / (now - self.start)
            left = (self.total - self.count) / rate
            print(
                f"{self.what}: {self.count}/{self.total} cells, {self.failures} failed, {rate:.1f}/s, "
                f"{left:.0f} s left",
                flush=True,
            )


class Bar:
    """A bar on a terminal."""

    def __init__(self, what: str, total: int) -> None:
        from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
        from rich.table import Column

        columns = (  # numbers are whole on a narrow terminal: the bar gives way
            TextColumn("{task.description}"),
            BarColumn(bar_width=None),
            MofNCompleteColumn(table_column=Column(no_wrap=True)),
            TextColumn("{task.fields[rate]}"),
            TimeRemainingColumn(table_column=Column(no_wrap=True)),
            TextColumn("{task.fields[failed]}"),
        )
        self.start, self.count, self.failures = time.monotonic(), 0, 0
        self.progress = Progress(*columns)
        self.task = self.progress.add_task(what, total=total, rate="", failed="")

    def advance(self, failures: int = 0) -> None:
        self.count += 1
        self.failures += failures
        rate = self.count / max(time.monotonic() - self.start, 1e-9)
        failed = f"{self.failures} failed" if self.failures else ""
        self.progress.update(self.task, advance=1, rate=f"{rate:.1f} cells/s", failed=failed)


@contextmanager
def watched(what: str, total: int) -> Iterator[Lines | Bar]:
    """A Bar where a person watches, Lines where not."""
    if not sys.stdout.isatty():
        yield Lines(what, total)
        return
    bar = Bar(what, total)
    with bar.progress:
        yield bar
