"""rows -> one SQLite file per study: written atomically as they come, found again by key."""

from __future__ import annotations

import contextlib
import json
import sqlite3
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from sysid_bench.nouns import InputError

BATCH = 500  # keys of one query


class Store:
    """The finished cells of one study. Several processes may write to the same file."""

    def __init__(self, path: Path) -> None:
        self.path = path
        try:
            self._db = sqlite3.connect(path, timeout=60, isolation_level=None)
            self._db.execute("PRAGMA journal_mode=WAL")
            self._db.execute("PRAGMA synchronous=NORMAL")
            self._db.execute(
                "CREATE TABLE IF NOT EXISTS rows (key TEXT PRIMARY KEY, status TEXT NOT NULL, row TEXT NOT NULL)"
            )
        except sqlite3.OperationalError as problem:
            raise OSError(None, _said(problem), str(path)) from None
        except sqlite3.DatabaseError as problem:
            raise InputError(
                f"{path} is not a store of results ({problem}); move it away to start anew."
            ) from None

    def __enter__(self) -> Store:
        return self

    def __exit__(self, *_: object) -> None:
        self._db.close()

    def add(self, rows: Iterable[dict[str, Any]]) -> None:
        """All of `rows` or none; a row of the same key is replaced. Raises OSError on a full disk."""
        values = [(row["key"], row["status"], json.dumps(row, default=_plain)) for row in rows]
        try:
            self._db.execute("BEGIN IMMEDIATE")
            self._db.executemany("INSERT OR REPLACE INTO rows VALUES (?, ?, ?)", values)
            self._db.execute("COMMIT")
        except sqlite3.OperationalError as problem:
            with contextlib.suppress(sqlite3.Error):
                self._db.execute("ROLLBACK")
            raise OSError(None, _said(problem), str(self.path)) from None

    def done(self, retry: Iterable[str] = ()) -> set[str]:
        """Keys of the finished cells, but for those whose status is to be tried again."""
        again = set(retry)
        rows = self._db.execute("SELECT key, status FROM rows")
        return {key for key, status in rows if status not in again}

    def rows(self, keys: Iterable[str]) -> Iterator[dict[str, Any]]:
        """The rows of `keys`, in their order; keys without a row are passed over."""
        batch: list[str] = []
        for key in keys:
            batch.append(key)
            if len(batch) == BATCH:
                yield from self._batch(batch)
                batch = []
        yield from self._batch(batch)

    def _batch(self, keys: list[str]) -> Iterator[dict[str, Any]]:
        marks = ",".join("?" * len(keys))
        found = dict(self._db.execute(f"SELECT key, row FROM rows WHERE key IN ({marks})", keys))
        yield from (json.loads(found[key]) for key in keys if key in found)


def _said(problem: sqlite3.Error) -> str:
    return (
        f"rows cannot be written ({problem}); those stored are kept. Make room and run the same command again"
    )


def _plain(value: Any) -> Any:
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, np.ndarray):
        return value.tolist()
    raise TypeError(f"a row holds numbers and words; got {type(value).__name__}")
