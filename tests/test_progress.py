"""The bar of a sweep on a terminal of 80 columns: every number whole, on one line."""

import io
import time

from rich.console import Console

from sysid_bench.progress import Bar


def drawn(width: int, what: str, total: int, done: int, failures: int) -> str:
    bar = Bar(what, total)
    bar.start = time.monotonic() - 50
    bar.count, bar.failures = done - 1, failures
    bar.progress.update(bar.task, completed=done - 1)
    bar.advance()
    console = Console(width=width, file=io.StringIO(), force_terminal=True, color_system=None)
    console.print(bar.progress.make_tasks_table(bar.progress.tasks))
    return console.file.getvalue().rstrip("\n")


def test_a_long_name_and_many_cells_fit_eighty_columns() -> None:
    line = drawn(80, "bruschetta_2011/fig5_2_5", 54000, 12345, 1234)
    assert "\n" not in line and len(line) <= 80
    for word in ("bruschetta_2011/fig5_2_5", " 12345/54000 ", " cells/s ", "1234 failed"):
        assert word in line


def test_the_bar_takes_the_room_that_is_left() -> None:
    narrow, wide = (drawn(width, "smoke", 132, 100, 0).count("━") for width in (80, 120))
    assert 0 < narrow < wide
