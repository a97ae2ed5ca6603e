"""Bytes and plain values -> files that are whole or absent, and back under limits."""

# json and yaml hand over values of any type.
# pyright: reportUnknownArgumentType=false, reportUnknownVariableType=false

from __future__ import annotations

import contextlib
import hashlib
import json
import math
import os
import tempfile
from collections.abc import Generator, Mapping
from pathlib import Path
from typing import IO, Any

import numpy as np

from sysid_bench.nouns import InputError

MAX_TEXT_BYTES = 64 * 2**20


def results_folder(path: str) -> Path:
    """The folder, made. Raises InputError where it cannot be."""
    folder = Path(path)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as problem:
        raise InputError(f"out={path}: a folder is wanted; cannot make it ({problem.strerror}).") from None
    return folder


@contextlib.contextmanager
def atomic_write(path: str | os.PathLike[str], mode: str = "wb") -> Generator[IO[Any], None, None]:
    """Open a temporary file beside `path` that takes its name only once it is whole and on the disk.

    Parent folders are made. Whatever goes wrong (exception, full disk, kill), `path` is as it was before.
    Raises InputError where the file cannot be written.
    """
    path = Path(path)
    temporary = None
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        number, temporary = tempfile.mkstemp(dir=path.parent, prefix=f".{_cut(path.name)}.", suffix=".part")
        with os.fdopen(number, mode, encoding=None if "b" in mode else "utf-8") as file:
            yield file
            file.flush()
            os.fsync(file.fileno())
        os.chmod(temporary, 0o666 & ~_umask())
        os.replace(temporary, path)
        temporary = None
        _sync_folder(path.parent)
    except OSError as problem:
        raise InputError(
            f"cannot write {path}: {problem.strerror or problem}. Nothing was left half-written; "
            "give another place or make room."
        ) from None
    finally:
        if temporary is not None:
            with contextlib.suppress(OSError):
                os.unlink(temporary)


def _cut(name: str, most: int = 100) -> str:
    """The name's first `most` bytes, whole characters: file systems count bytes (255 for a name)."""
    return os.fsencode(name)[:most].decode("utf-8", "ignore")


@contextlib.contextmanager
def locked(folder: Path) -> Generator[None, None, None]:
    """One process at a time inside, per folder; the system gives the lock back when its holder is killed."""
    try:
        import fcntl
    except ImportError:  # a system without such locks: two processes on one folder are then on their own
        yield
        return
    with open(folder / ".lock", "w") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        yield


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask


def _sync_folder(folder: Path) -> None:
    """Make the new name itself survive a power cut, where the system can."""
    with contextlib.suppress(OSError):
        number = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(number)
        finally:
            os.close(number)


def existing_file(path: str | os.PathLike[str], what: str) -> Path:
    """`path` as a Path. Raises InputError where there is no such file or it is empty."""
    path = Path(path)
    if not path.exists():
        parts = [part for part in str(path).split(",") if part]
        if len(parts) > 1:
            raise InputError(
                f"{what}: one file is wanted here; got {len(parts)}, separated by commas: {path}."
            )
        raise InputError(f"{what}: no file {str(path)!r} (from {os.getcwd()}).")
    if not path.is_file():
        raise InputError(f"{what}: {path} is not a file.")
    if path.stat().st_size == 0:
        raise InputError(f"{what}: {path} is empty (0 bytes).")
    return path


def read_text(path: str | os.PathLike[str], what: str) -> str:
    """Text of a file of moderate size. Raises InputError: absent, empty, too large, not UTF-8."""
    path = existing_file(path, what)
    if path.stat().st_size > MAX_TEXT_BYTES:
        raise InputError(
            f"{what}: {path} has {path.stat().st_size:,} bytes; at most {MAX_TEXT_BYTES:,} are read."
        )
    try:
        return path.read_bytes().decode("utf-8-sig")
    except UnicodeDecodeError as problem:
        raise InputError(f"{what}: {path} is not UTF-8 text (byte {problem.start}).") from None
    except OSError as problem:
        raise InputError(f"{what}: cannot read {path}: {problem.strerror}.") from None


def sha256(path: str | os.PathLike[str]) -> str:
    """Hash of a file's bytes, hexadecimal."""
    with open(path, "rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def plain(value: Any) -> Any:
    """The same value in JSON's types: arrays become lists, complex numbers [re, im], NaN and Inf None."""
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, np.ndarray | np.generic):
        return plain(value.tolist())
    if isinstance(value, list | tuple | set | frozenset):
        return [plain(item) for item in value]
    if isinstance(value, complex):
        return [plain(value.real), plain(value.imag)]
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if value is None or isinstance(value, bool | int | str):
        return value
    return str(value)


def json_text(value: Any) -> str:
    """Readable JSON of any value (see `plain`): innermost lists stay on one line."""
    return _indented(plain(value), "") + "\n"


def _indented(value: Any, margin: str) -> str:
    if isinstance(value, dict) and value:
        inner = margin + "  "
        rows = [
            f"{inner}{json.dumps(k, ensure_ascii=False)}: {_indented(v, inner)}" for k, v in value.items()
        ]
        return "{\n" + ",\n".join(rows) + f"\n{margin}}}"
    if isinstance(value, list) and any(isinstance(item, list | dict) for item in value):
        inner = margin + "  "
        return "[\n" + ",\n".join(inner + _indented(item, inner) for item in value) + f"\n{margin}]"
    return json.dumps(value, ensure_ascii=False, allow_nan=False)


def read_json(path: str | os.PathLike[str], what: str) -> Any:
    """Value of a JSON file. Raises InputError with line and column."""
    text = read_text(path, what)
    try:
        return json.loads(text)
    except json.JSONDecodeError as problem:
        raise InputError(
            f"{what}: {path} is not JSON: {problem.msg} at line {problem.lineno}, column {problem.colno}."
        ) from None
    except (RecursionError, ValueError) as problem:
        raise InputError(f"{what}: {path} cannot be read as JSON ({type(problem).__name__}).") from None


def write_json(path: str | os.PathLike[str], value: Any) -> None:
    """Write any value as JSON, atomically."""
    with atomic_write(path, "w") as file:
        file.write(json_text(value))
