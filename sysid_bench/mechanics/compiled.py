"""where compiled loops are kept between processes, and whether they are there already.

numba keeps them beside the source or in the user's cache; where neither can be written (a read-only install without a
home), a folder of the system's temporary ones serves, else every process compiles anew.
"""

from __future__ import annotations

import os
import sys
import tempfile
from pathlib import Path
from typing import Any

# Of a loop that makes no array of its own: without a count of references, which would cost more than a step's arithmetic.
UNCOUNTED: dict[str, Any] = {"cache": True, "error_model": "numpy", "_nrt": False}
SECONDS = 20  # that compiling takes, about


def writable(folder: Path) -> bool:
    """True where a file can be made in the folder, which is made if need be."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return True
    except OSError:
        return False


def cache_folder(beside: Path, own: Path, temporary: Path) -> Path | None:
    """None where numba finds a place itself (beside the source, or the user's own); else a temporary folder."""
    if "NUMBA_CACHE_DIR" in os.environ or writable(beside) or writable(own):
        return None
    return temporary / f"sysid_bench_compiled_{os.getuid() if hasattr(os, 'getuid') else 0}"


def prepare() -> None:
    """Tell numba where to keep what it compiles, before the first loop is declared."""
    home = Path(os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache"))
    folder = cache_folder(Path(__file__).parent / "__pycache__", home / "numba", Path(tempfile.gettempdir()))
    if folder is None:
        return
    os.environ["NUMBA_CACHE_DIR"] = str(folder)
    print(f"sysid-bench: compiled loops are kept in {folder}: no other place can be written", file=sys.stderr)


def is_compiled(function) -> bool:
    """True where a compiled loop is in memory or in the cache, of this very source."""
    if function.signatures:
        return True
    try:
        return bool(function._cache._cache_file._load_index())
    except (AttributeError, OSError):  # another version of numba keeps it elsewhere: say nothing
        return True
