"""Who may import whom."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parents[1] / "sysid_bench"
SHELVES = set("plants excitations noises effects methods sources buses rigs executors analyses".split())
BASE = set("nouns mechanics plan score regress versions".split())
ABOVE = set("run conf doors studies store table gap contracts __main__".split())


def imports(path: Path) -> set[str]:
    found = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            found |= {node.module} | {f"{node.module}.{alias.name}" for alias in node.names}
    return found


@pytest.mark.parametrize("path", sorted(PACKAGE.rglob("*.py")), ids=lambda p: str(p.relative_to(PACKAGE)))
def test_floor(path: Path) -> None:
    here = path.relative_to(PACKAGE)
    room = here.parts[0].removesuffix(".py")
    used = imports(path)
    own = {name.split(".")[1] for name in used if name.startswith("sysid_bench.")}
    if str(here) not in ("conf.py", "__main__.py"):
        assert not {n for n in used if n.split(".")[0] in ("hydra", "omegaconf")}, (
            "only conf and __main__ know Hydra"
        )
    if room not in ("doors", "views"):
        assert "views" not in own, "nothing imports views but doors"
    if room in SHELVES:
        assert not own & ((ABOVE | SHELVES) - {room}), "a shelf file imports another room"
        assert not {n for n in used if n.startswith(f"sysid_bench.{room}.")}, (
            "a shelf file imports its siblings"
        )
    if room in BASE:
        assert own <= BASE, f"the base imports {own - BASE}"


@pytest.mark.parametrize("heavy", ["rerun", "matplotlib", "can", "dask", "hydra"])
def test_importing_the_core_pulls_in_nothing_heavy(heavy: str) -> None:
    core = "nouns, plan, build, score, run, regress, store, table"
    code = f"import sys; from sysid_bench import {core}; sys.exit({heavy!r} in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
