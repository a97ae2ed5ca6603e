"""The executors: same rows, a dead or hanging worker costs one cell."""

from typing import Any

import pytest
from tasks import SlowStart, by_key, task, work

from sysid_bench.executors.local import Local
from sysid_bench.executors.serial import Serial
from sysid_bench.nouns import InputError


def test_local_gives_the_rows_of_serial() -> None:
    tasks = [task(f"t{k}", "ok", "ok") for k in range(7)]
    assert by_key(Local(workers=2).run(work, tasks)) == by_key(Serial().run(work, tasks))


def test_a_native_crash_and_a_hang_are_rows_and_the_rest_goes_on() -> None:
    tasks = [task("a", "ok", "die", "ok"), task("b", "exit"), task("c", "hang", "ok"), task("d", "ok")]
    rows = by_key(Local(workers=2, cell_timeout_s=3.0).run(work, tasks))
    assert len(rows) == 7
    assert rows["a1"]["status"] == "error" and "SIGSEGV" in rows["a1"]["reason"]
    assert rows["b0"]["status"] == "error" and "exit code 3" in rows["b0"]["reason"]
    assert rows["c0"]["status"] == "timeout" and "3 s" in rows["c0"]["reason"]
    assert {rows[k]["status"] for k in ("a0", "a2", "c1", "d0")} == {"ok"}


def test_the_start_of_a_worker_is_no_cell_s_time() -> None:
    rows = by_key(Local(workers=1, cell_timeout_s=1.5).run(SlowStart(), [task("a", "ok"), task("b", "ok")]))
    assert {row["status"] for row in rows.values()} == {"ok"}


def test_no_tasks_give_no_rows() -> None:
    assert list(Local(workers=1).run(work, [])) == []


@pytest.mark.parametrize("knobs", [{"workers": 0}, {"cell_timeout_s": 0.0}])
def test_senseless_knobs_are_refused(knobs: dict[str, Any]) -> None:
    with pytest.raises(InputError, match="executor"):
        Local(**knobs)
