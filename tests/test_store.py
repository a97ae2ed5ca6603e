"""The store: rows by key, in the order asked for, whatever happens around it."""

from pathlib import Path

import numpy as np
import pytest

from sysid_bench.nouns import InputError
from sysid_bench.store import Store


def row(key: str, status: str = "ok", **more: object) -> dict[str, object]:
    return {"key": key, "status": status, **more}


def test_rows_come_back_in_the_order_of_the_keys(tmp_path: Path) -> None:
    with Store(tmp_path / "rows.sqlite") as store:
        store.add([row(f"k{i}", value=np.float64(i) / 3) for i in range(1200)])
        keys = [f"k{i}" for i in reversed(range(1200))] + ["absent"]
        rows = list(store.rows(keys))
    assert [r["key"] for r in rows] == keys[:-1]
    assert rows[0]["value"] == 1199 / 3


def test_retry_takes_failed_rows_out_of_done(tmp_path: Path) -> None:
    with Store(tmp_path / "rows.sqlite") as store:
        store.add([row("a"), row("b", "timeout"), row("c", "diverged")])
        assert store.done() == {"a", "b", "c"}
        assert store.done(retry=["timeout"]) == {"a", "c"}
        store.add([row("b")])
        assert store.done(retry=["timeout"]) == {"a", "b", "c"}


def test_a_batch_is_written_whole_or_not_at_all(tmp_path: Path) -> None:
    with Store(tmp_path / "rows.sqlite") as store:
        with pytest.raises(TypeError):
            store.add([row("a"), row("b", value=object())])
        assert store.done() == set()


def test_two_writers_share_a_file(tmp_path: Path) -> None:
    with Store(tmp_path / "rows.sqlite") as one, Store(tmp_path / "rows.sqlite") as two:
        one.add([row("a")])
        two.add([row("b"), row("a")])
        assert one.done() == two.done() == {"a", "b"}


def test_a_foreign_file_is_refused(tmp_path: Path) -> None:
    (tmp_path / "rows.sqlite").write_text("this is no database, but long enough to be read as one" * 50)
    with pytest.raises(InputError, match="not a store"):
        Store(tmp_path / "rows.sqlite")
